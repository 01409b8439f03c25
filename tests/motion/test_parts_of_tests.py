"""A part of a test is used, and noise that ends within a test is known where it is."""

import numpy as np
import pytest

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.pad import cut


def pulled():
    time = np.arange(0.0, 40.0, 0.1)
    return Pad("strip", (Test("pull", "strip", time, 1.0 * time, np.sqrt(time)),), PAD)


def test_a_part_of_a_test_is_used_and_told():
    pad, notices = cut(pulled(), ["pull:0..18mm"])
    (test,) = pad.tests
    assert (test.time[0], test.displacement[-1]) == (0.0, pytest.approx(18.0))
    told = "181 rows are used, as stated by pull:0..18mm, and 219 left out"
    assert notices == (f"pad strip: of test pull {told}",)
    (late,) = cut(pulled(), ["strip/pull:5..9 s"])[0].tests
    assert (late.time[0], late.displacement[0], late.start_s) == (0.0, 5.0, 5.0)
    assert cut(pulled(), [])[1] == ()
    with pytest.raises(InputError, match="leaves fewer than 10 rows"):
        cut(pulled(), ["pull:0..0.5mm"])
    with pytest.raises(InputError, match="is no part of a test"):
        cut(pulled(), ["pull 0 to 18"])


@pytest.mark.parametrize("seed", range(2))
def test_noise_that_ends_at_once_is_known_where_it_is(seed):
    """A step of stress of 0.06 held for 60 s, under noise of 3, 0.1 and 0.001 one after another."""
    time = np.geomspace(0.01, 60.0, 150)
    strain = np.minimum(time / 0.09, 1.0) * 1e-3
    true = np.select([time < 0.3, time < 3.0], [3.0, 0.1], 0.001)
    stress = 60.0 * strain + true * np.random.default_rng(seed).standard_normal(time.size)
    units = UnitSystem("1", "Pa")
    experiment = prepare(Pad("gel", (Test("r", "gel", time, strain, stress),), units))
    (trial,) = experiment.trials
    found = trial.test.force_sd
    steps = np.searchsorted(time, [0.3, 3.0])
    # windows of 21 readings that hold no step; a third are independent: 2.5 is three sds and more
    away = np.all(np.abs(np.arange(time.size)[:, None] - steps) > 12, axis=1)
    assert np.all(np.abs(np.log(found / true))[away] < np.log(2.5))
    assert 0.05 < experiment.peak < 0.5  # and not the 8 of the largest noise
    late = time > 3.5
    weights = 1.0 / found[late] ** 2
    assert weights @ stress[late] / weights.sum() == pytest.approx(0.06, rel=0.01)
