"""The last fit of every pad of a study: to all tests, whatever the verdict."""

import pytest
from support.endtoend import PADS
from support.written_results import check, diagnosis, write

from qlvbayes.fitting.ensemble import Settings
from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.pipeline import run as finals
from qlvbayes.pipeline.many import Tally
from qlvbayes.pipeline.source import alone
from qlvbayes.pipeline.steps import Watcher

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
    plain = tmp_path / "B" / "plain"
    checked = check("B")
    for cell in checked["cells"]:
        cell["role"] = roles[cell["role"] == "validate"]
    write(plain / "check.json", checked)
    write(tmp_path / "B" / "diagnosis.json", diagnosis("B", verdict))
    for name in ("posterior.nc", "forces.png", "pairs.png"):
        (plain / name).write_text(name)
    work = []
    monkeypatch.setattr(
        finals, "run_pads", lambda out, some, **_: work.extend(some) or Tally((), ())
    )
    study = read_measurements(PADS)
    pads, watcher = [alone(study, study.pad("B"))], Watcher()
    finals.run_finals(
        tmp_path, pads, lambda study: Choices(), Settings(), size=1, engine=None, watcher=watcher
    )
    steps = work[0].steps
    assert [step.name for step in steps] == names
    assert all(step.all_tests for step in steps[:1])
    if verdict == "missing_effect":
        assert steps[0].choices.effects == ("viscous_drag",)
    kept = {path.name for path in (tmp_path / "B").iterdir() if path.is_file()}
    assert kept - {"diagnosis.json"} == expected
