"""The last fit of every pad of a study: to all tests, whatever the verdict."""

from types import SimpleNamespace

import pytest
from support.written_results import check, diagnosis, write

from qlvbayes.model.choices import Choices
from qlvbayes.pipeline.run import FinalStep
from qlvbayes.pipeline.steps import CheckStep, FitStep, Watcher

APART, TOGETHER = ("fit", "validate"), ("fit", "fit")
PREDICTED = {"check.json", "forces.png"}


@pytest.mark.parametrize(
    ("verdict", "roles", "names", "expected"),
    [
        ("missing_effect", APART, ["fit", "check"], set()),
        ("adequate", APART, ["fit"], PREDICTED),
        ("adequate", TOGETHER, [], PREDICTED | {"pairs.png", "posterior.nc"}),
    ],
)
def test_the_last_fit_is_to_all_tests_and_keeps_what_still_holds(
    tmp_path, monkeypatch, verdict, roles, names, expected
):
    """What is named is fitted and checked; where no test was left out the plain fit is the last."""
    plain = tmp_path / "plain"
    checked = check("B")
    for cell in checked["cells"]:
        cell["role"] = roles[cell["role"] == "validate"]
    write(plain / "check.json", checked)
    write(tmp_path / "diagnosis.json", diagnosis("B", verdict))
    for name in ("posterior.nc", "forces.png", "pairs.png"):
        (plain / name).write_text(name)
    steps, told = [], []
    for kind in (FitStep, CheckStep):
        monkeypatch.setattr(kind, "run", lambda step, *_: steps.append(step))
        monkeypatch.setattr(kind, "report", lambda step, *_: told.append(step))
    final = FinalStep(Choices())
    final.run(tmp_path, SimpleNamespace(), Watcher())
    final.report(tmp_path, Watcher())
    assert [step.name for step in steps] == names
    assert told == steps
    assert all(step.all_tests for step in steps[:1])
    if verdict == "missing_effect":
        assert steps[0].choices.effects == ("viscous_drag",)
    kept = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert kept - {"diagnosis.json"} == expected
