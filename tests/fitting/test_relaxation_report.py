"""Check that a relaxation report states what the readings of each held test say."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support.endtoend import PADS

from qlvbayes.fitting.relaxation import relaxation_report
from qlvbayes.io.data import read_measurements
from qlvbayes.motion.experiment import prepare


@pytest.fixture(scope="module")
def experiment():
    return prepare(read_measurements(PADS).pad("B"))


@pytest.fixture(scope="module")
def report(experiment):
    return relaxation_report(experiment)


def test_shares_are_those_of_the_readings_and_what_came_before_is_stated(report):
    read = pd.read_csv(PADS, comment="#")
    assert len(report.tests) == 6
    for held in report.tests:
        rows = read[read["test"] == held.test]
        down = rows[rows["displacement_mm"] > 1.599]
        start = down["time_s"].iloc[0]
        assert held.deformation == pytest.approx(1.6, abs=1e-3)
        assert held.initial == pytest.approx(rows["force_N"].max(), rel=0.02)
        assert held.at == (1.0, 10.0)
        for moment, share in zip(held.at, held.left, strict=True):
            near = down[np.abs(down["time_s"] - start - moment) <= 0.2 * moment]["force_N"]
            assert share == pytest.approx(near.mean() / held.initial, abs=0.02)
    histories = [held.history for held in report.tests]
    assert histories[0] == "the specimen's first test in the file"
    assert histories[3] == "after 3 tests, 120 s after the last one's end"


def test_a_pad_that_was_never_held_has_none(experiment):
    trials = [replace(t, phases=t.phases[:1]) for t in experiment.trials]
    assert relaxation_report(replace(experiment, trials=tuple(trials))) is None
