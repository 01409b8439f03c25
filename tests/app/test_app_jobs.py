"""Check what a job's process reports to the server, and which models it takes for the same."""

import time
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import pytest

from qlvbayes.app import job
from qlvbayes.app.job import ProgressReporter, _choices
from qlvbayes.diagnosis.decision import Decision
from qlvbayes.diagnosis.progress import SearchProgress, StopSearch
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.runs import RunLog
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.pipeline.steps import CheckStep, DiagnoseStep, FitStep

DATA = Path(__file__).parents[2] / "data" / "pads.csv"
STANDING = SearchProgress(
    "effects",
    3,
    Hypothesis("hertz", "prony:2"),
    Decision("ambiguous", (), (), {"friction": 0.2}, {("hertz", "prony:2"): 1.0}, 0.0, 0),
)


@pytest.fixture
def reporter():
    lines = []
    watcher = ProgressReporter(SimpleNamespace(send=lines.append))
    yield watcher, lines
    watcher.end()


def test_a_chain_tells_how_far_it_is_and_what_is_left(reporter):
    watcher, lines = reporter
    with watcher.sampling("pad B: emcee") as progress:
        progress(200, 100)  # more is found to be done
        while not any(line["done"] for line in lines):
            time.sleep(0.05)
    line = next(line for line in lines if line["done"])
    assert (line["text"], line["done"], line["total"]) == ("pad B: emcee", 200, 200)
    assert line["left_s"] == 0.0


def test_a_step_tells_what_it_does(reporter):
    watcher, lines = reporter
    with watcher.doing("pad B") as report:
        report("elastic laws")
        while not any(line["text"] == "pad B: elastic laws" for line in lines):
            time.sleep(0.05)


def test_a_search_tells_the_probabilities_so_far(reporter):
    """The probabilities of a law are summed over the other law of each pair."""
    watcher, lines = reporter
    base = {("hertz", "prony:2"): 0.6, ("hertz", "fung"): 0.3, ("linear", "fung"): 0.1}
    inclusion = {"friction": 0.2, "viscous_drag": 0.7}
    decision = Decision("ambiguous", (), (), inclusion, base, 0.0, 0)
    best = Hypothesis("hertz", "prony:2")
    watcher.searched("B", SearchProgress("effects", 3, best, decision))
    found = next(line["probabilities"] for line in lines if "probabilities" in line)
    assert found["pad"] == "B"
    assert [(one["effect"], one["probability"]) for one in found["ranking"]] == [
        ("viscous_drag", 0.7),
        ("friction", 0.2),
    ]
    for kind, shares in (
        ("elastic", {"hertz": 0.9, "linear": 0.1}),
        ("relaxation", {"prony:2": 0.6, "fung": 0.4}),
    ):
        given = {one["name"]: one["probability"] for one in found["laws"][kind]}
        assert given == pytest.approx(shares)


def test_a_search_that_has_told_enough_ends_once(reporter):
    """It ends at its next step, whose probabilities are reported first; the summing up goes on."""
    watcher, lines = reporter
    watcher.searched("B", STANDING)
    watcher.enough()
    with pytest.raises(StopSearch):
        watcher.searched("B", STANDING)
    assert sum("probabilities" in line for line in lines) == 2
    watcher.searched("B", STANDING)


def test_a_job_samples_the_model_on_the_bench():
    model = {"elastic": "hertz", "relaxation": "prony:3", "effects": ["friction"]}
    choices = _choices(model, True, None)
    assert (choices.elastic, choices.relaxing, choices.effects) == (
        "hertz",
        "prony:3",
        ("friction",),
    )
    assert choices.bonded
    assert _choices({**model, "relaxation": "fung"}, False, None).relaxing == "fung"


def test_a_job_notes_what_it_was_told(tmp_path, monkeypatch):
    """It notes settings as the commands do, and passes the same to its steps."""
    passed = {}
    for kind in (FitStep, CheckStep, DiagnoseStep):
        monkeypatch.setattr(kind, "run", lambda step, *_: passed.update({step.name: step}))
    spec = {"data": str(DATA), "out": str(tmp_path), "pads": ["B"], "models": {}}
    spec |= {"all_tests": True, "effects_file": None}
    job.diagnosed(spec, None)
    job.sampled(spec, None)
    runs = RunLog.read(tmp_path / "run.json").runs
    assert runs["diagnose"].settings == {"thresholds": asdict(DiagnosisSettings())}
    assert passed["diagnose"].thresholds == DiagnosisSettings()
    sampler = asdict(Settings())
    assert runs["fit"].settings == {"method": "emcee", "all_tests": True, "sampler": sampler}
    assert passed["fit"].settings == Settings()
    assert passed["fit"].all_tests
