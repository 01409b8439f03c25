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


@pytest.fixture
def finals_of(tmp_path, monkeypatch):
    """The steps of the last fit of pad B, given its verdict and the roles of its tests."""

    def found(verdict, roles=("fit", "validate")):
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
        finals.run_finals(
            tmp_path,
            [alone(study, study.pad("B"))],
            lambda study: Choices(),
            Settings(),
            size=1,
            engine=None,
            watcher=Watcher(),
        )
        kept = {path.name for path in (tmp_path / "B").iterdir() if path.is_file()}
        return work[0].steps, kept - {"diagnosis.json"}

    return found


def test_what_is_named_is_fitted_to_all_tests_and_checked(finals_of):
    steps, kept = finals_of("missing_effect")
    assert [step.name for step in steps] == ["fit", "check"]
    assert steps[0].all_tests
    assert steps[0].choices.effects == ("viscous_drag",)
    assert kept == set()


def test_an_adequate_pad_is_fitted_to_all_tests_and_keeps_its_predictions(finals_of):
    steps, kept = finals_of("adequate")
    assert [step.name for step in steps] == ["fit"]
    assert steps[0].all_tests
    assert kept == {"check.json", "forces.png"}


def test_where_no_test_was_left_out_the_plain_fit_is_the_last_one(finals_of):
    steps, kept = finals_of("adequate", roles=("fit", "fit"))
    assert steps == ()
    assert kept == {"check.json", "forces.png", "pairs.png", "posterior.nc"}
