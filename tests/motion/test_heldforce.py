"""A force that is read more slowly than the rows counts once a reading; a coarse one is no such."""

from dataclasses import replace

import numpy as np
import pytest

from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.polling import fresh_forces

MM = UnitSystem("mm", "N")
RATE, NOISE = 100.0, 3e-3  # rows a second, N
SLOW = ([0.0, 0.5, 4.1, 12.0, 13.6, 17.0], [-0.2, -0.2, 1.6, 1.6, 0.8, 0.8])
QUICK = ([0.0, 0.5, 0.86, 9.0, 9.2, 13.0], [-0.2, -0.2, 1.6, 1.6, 0.8, 0.8])


def a_test(course, seed, name="press"):
    """A standard linear solid, 0.4 + 0.4 e^{-t / 0.5 s}, pressed from 0 on, with white noise."""
    time = np.arange(0.0, course[0][-1], 1.0 / RATE)
    displacement = np.interp(time, *course)
    pressed, relaxing = np.maximum(displacement, 0.0), np.zeros(time.size)
    keep = np.exp(-1.0 / RATE / 0.5)
    for k, step in enumerate(np.diff(pressed)):
        relaxing[k + 1] = keep * relaxing[k] + np.sqrt(keep) * step
    noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
    force = 0.4 * pressed + 0.4 * relaxing + noise
    return Test(name, "p", time, displacement, np.round(force, 4))


def held(test, lengths):
    """Repeat each reading of the force for so many rows."""
    first = np.cumsum([0, *lengths])
    first = first[first < test.time.size]
    return replace(
        test,
        force=test.force[first[np.searchsorted(first, np.arange(test.time.size), "right") - 1]],
    ), first


def jittered(seed, low, high):
    return np.random.default_rng(seed).integers(low, high + 1, 3000).tolist()


@pytest.mark.parametrize(
    "lengths",
    [[2] * 3000, [3] * 3000, [10] * 3000, [25] * 3000, jittered(0, 7, 13), jittered(1, 2, 6)],
)
def test_only_the_first_row_of_each_repeat_counts(lengths):
    tests, firsts = zip(*(held(a_test(SLOW, k, f"t{k}"), lengths) for k in (1, 2)), strict=True)
    experiment = prepare(Pad("p", tests, MM))
    for trial, test, first in zip(experiment.trials, tests, firsts, strict=True):
        assert np.count_nonzero(~np.isin(trial.test.time, test.time[first])) <= 0.02 * first.size
        assert np.count_nonzero(~np.isin(test.time[first], trial.test.time)) <= 0.02 * first.size
        assert [p.kind for p in trial.phases] == ["hold", "ramp", "hold", "unload", "recovery"]
    assert experiment.floor.total == pytest.approx(NOISE, rel=0.35)
    assert experiment.floor.ou < 0.7 * NOISE
    assert sum("read only about every" in text for text in experiment.notices) == 2


def test_a_quick_test_is_judged_by_the_load_cell_of_the_others():
    slow, quick = (held(a_test(*one), [10] * 3000)[0] for one in ((SLOW, 1, "a"), (QUICK, 2, "b")))
    fresh = fresh_forces([slow, quick])
    for test, mask in zip((slow, quick), fresh, strict=True):
        assert mask is not None
        assert np.count_nonzero(mask) == pytest.approx(test.time.size / 10, rel=0.02)


def test_one_quick_test_shows_it_where_the_platen_rests():
    (mask,) = fresh_forces([held(a_test(QUICK, 2), [10] * 3000)[0]])
    assert mask is not None
    assert np.count_nonzero(mask) == pytest.approx(QUICK[0][-1] * RATE / 10, rel=0.02)


@pytest.mark.parametrize("step", [1e-4, 0.01, 0.03, 0.1])
@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("course", [SLOW, QUICK])
@pytest.mark.few(6)
def test_a_converter_however_coarse_is_read_in_every_row(step, noise, course):
    test = a_test(course, 3)
    smooth = a_test(course, 4)
    force = smooth.force + noise * (test.force - smooth.force)
    coarse = replace(test, force=np.round(force / step) * step)
    assert fresh_forces([coarse]) == [None]


def test_stairs_taken_within_one_row_are_no_repeats():
    time = np.arange(0.0, 60.0, 0.01)
    stairs = np.minimum(np.floor(time / 2.0), 25.0) * 0.1
    since = time % 2.0
    force = np.round((stairs * 0.5 + 0.05 * np.exp(-since) * (stairs > 0.0)) / 0.02) * 0.02
    assert fresh_forces([Test("s", "p", time, stairs, force)]) == [None]


def test_no_force_before_contact_is_no_repeat():
    test = a_test(SLOW, 1)
    force = np.where(test.displacement <= 0.0, 0.0, 0.5 * np.maximum(test.displacement, 0.0) ** 1.5)
    assert fresh_forces([replace(test, force=force)]) == [None]
