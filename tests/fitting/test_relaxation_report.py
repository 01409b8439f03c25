"""Check that a relaxation report states what the readings of each held test say."""

from dataclasses import replace

import msgspec
import numpy as np
import pandas as pd
import pytest
from support.endtoend import PADS
from support.written_results import write_study

from qlvbayes import write_report
from qlvbayes.fitting.relaxation import RelaxationReport, relaxation_report
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


def test_the_text_states_what_is_known_and_what_is_not(report):
    text = report.text()
    for words in (
        "what ISO 3384-1 and ASTM D6147 ask to state",
        "Specimen: shape, size and preparation not stated",
        "Temperature: not stated",
        "Test B-20: displacement 1.6 mm at 20 mm/s, in 0.0999 s; held 30 s",
        "relaxation curves are not to be extrapolated",
    ):
        assert words in text
    assert RelaxationReport.from_json(report.to_json()) == report


def test_a_pad_that_was_never_held_has_none(experiment):
    trials = [replace(t, phases=t.phases[:1]) for t in experiment.trials]
    assert relaxation_report(replace(experiment, trials=tuple(trials))) is None


def test_the_page_states_it_and_takes_its_words_for_text(report, tmp_path):
    write_study(tmp_path)
    hostile = "<img src=x onerror=alert(1)>"
    held = msgspec.structs.replace(report.tests[0], test=hostile)
    msgspec.structs.replace(report, tests=(held,)).write(tmp_path / "B" / "relaxation.json")
    page = write_report(tmp_path).read_text()
    assert "Pad B: stress relaxation, as test standards ask to state it" in page
    assert "Pad C: stress relaxation" not in page
    assert "initial force 0." in page
    assert hostile not in page
