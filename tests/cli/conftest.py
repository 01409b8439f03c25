"""One fit and one study, which the files of this folder share."""

from pathlib import Path

import pytest
from support.endtoend import call, with_tests

from qlvbayes.effects.catalogue import EFFECTS, find
from qlvbayes.model.choices import Choices

HIDDEN = Path(__file__).parents[2] / "data" / "hidden.csv"


@pytest.fixture(scope="session")
def done(tmp_path_factory):
    """Fit and check three tests of pad B: its folder, and what each command gave."""
    place = tmp_path_factory.mktemp("done")
    data, folder = with_tests(place / "some.csv", "B-1", "B-20", "B-100"), place / "out"
    fit = call("fit", data, "-o", folder, "--method", "least-squares", drawn=("forces",))
    check = call("check", folder)
    return folder / "B", fit, check


@pytest.fixture(scope="session", params=["few", pytest.param("all", marks=pytest.mark.slow)])
def case(request, tmp_path_factory):
    """The bundled file and every candidate, or two of its tests and two candidates."""
    if request.param == "all":
        return HIDDEN, EFFECTS
    file = tmp_path_factory.mktemp("case") / "some.csv"
    with_tests(file, "C-20", "C-100", data=HIDDEN)
    return file, (find("friction"), find("squeeze_film"))


@pytest.fixture(scope="session")
def study(case, tmp_path_factory):
    """The whole loop, with a short chain: the pad's folder, and what was printed."""
    file, kinds = case
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Choices, "candidates", kinds)
        status, out, _ = call(
            "study", file, "-o", folder, "--max-steps", "60", drawn=kinds is EFFECTS
        )
    assert status == 0
    return folder / "C", out
