"""Records that others made, of kinds on which something went wrong, and what is right of them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.solids import kinds

from qlvbayes.io.checks import InputError
from qlvbayes.io.conversion import convert
from qlvbayes.io.data import Control, read_measurements
from qlvbayes.io.loading import Answers
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.falling import falls_of
from qlvbayes.motion.phases import find_phases
from qlvbayes.motion.trajectory import smooth

SHARED = Path(__file__).parents[3] / "shared" / "records"
pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason="the records are not here")


def test_zeros_workbooks_and_a_curve_of_an_afm():
    (found,) = convert([SHARED / "sphere.csv"]).tests
    assert abs(found.zero - 3.0) < min(0.1, 2.0 * found.zero_sd)
    for name in ("moves_at_once.csv", "coarse.csv"):
        assert convert([SHARED / name]).tests[0].zero == 0.0
    pytest.importorskip("python_calamine")
    found = convert([SHARED / "allongement.xlsx"], Answers.from_words(pad_from="[A-Z]+"))
    assert [test.pad for test in found.tests] == ["AA", "AA", "BB", "BB"]
    assert len(convert([SHARED / "mean_named_last.xlsx"]).tests) == 2
    with pytest.raises(InputError, match="before 2007"):
        convert([SHARED / "old.xls"])
    pytest.importorskip("afmformats")
    (found,) = convert([SHARED / "press_pause_back.tab"]).tests
    assert (found.signs.way, found.signs.load) == (1, 1)


@pytest.mark.parametrize(("folder", "contact"), [("film_stage", 12.412), ("one_stage", 7.0)])
def test_stages(folder, contact):
    files = sorted((SHARED / folder).glob("*.csv"))
    tests = convert(files, Answers.from_words(pads=("P",)), without_faulty=True).tests
    (zero,) = {test.zero for test in tests}
    assert abs(zero - contact) < 2.0 * tests[0].zero_sd
    assert tests[0].zero_sd < 0.02
    if folder == "one_stage":
        known = {test.test: test for test in tests}
        assert "p4_dead" not in known
        # 0.112 N of which 25 mN are the cell's own
        assert known["p3_late"].force[0] == pytest.approx(0.112 - 0.025, abs=0.004)


def test_strangers():
    folder = SHARED / "strangers"
    blocks = [folder / f"{name}.csv" for name in ("one_test", "two_blocks", "three_blocks")]
    first, *others = (convert([path]).tests for path in blocks)
    for same in others:
        np.testing.assert_array_equal(same[0].displacement, first[0].displacement)
        np.testing.assert_array_equal(same[0].force, first[0].force)
    with pytest.raises(InputError, match="largest where the test begins"):
        convert([folder / "retract.csv"])
    assert len(convert([folder / "two_units.csv"]).tests) == 1
    zeros = [folder / "zeros" / f"{name}.csv" for name in "ABC"]
    assert convert(zeros).tests[-1].zero == convert(zeros[-1:]).tests[0].zero == 0.0
    weights = [folder / f"dead_weight{more}.csv" for more in ("", "_control")]
    plain, stated = (read_measurements(path).pads[0].tests[0] for path in weights)
    assert plain.control == stated.control == Control.FORCE
    assert len(convert([folder / "no_x_column.lvm"]).tests[0].time) == 486
    with pytest.raises(InputError, match="there is no time"):
        read_measurements(folder / "no_time.txt")


def test_a_pause_under_a_force_tears_and_a_scatter_of_a_quarter_step():
    (trial,) = prepare(read_measurements(SHARED / "press_pause_back_tidy.csv").pads[0]).trials
    assert kinds(trial.phases)[:3] == ["ramp", "hold", "unload"]
    held = trial.phases[1]
    assert (held.start, held.stop) == pytest.approx((1.8, 3.8), abs=0.04)
    (pad,) = read_measurements(SHARED / "tears_in_4.csv").pads
    (trial,) = prepare(pad, keep_all_readings=True).trials
    tears = falls_of(trial.test, trial.trajectory, trial.phases)
    reported = [tear.displacement for tear in tears]
    assert reported == pytest.approx([17.9, 21.5, 22.3, 33.1], abs=0.11)
    read = pd.read_csv(SHARED / "scatter_quarter_step.csv")
    fit = smooth(read["time_s"].to_numpy(), read["displacement_mm"].to_numpy())
    assert np.abs(fit.displacement(np.linspace(0.0, 41.18, 50_001))).max() < 2.002
    assert kinds(find_phases(fit)) == ["hold", "ramp", "hold"]
