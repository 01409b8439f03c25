"""Laws on the command line: chosen by name, listed, taken from a file of one's own."""

import json

import pytest
from support.endtoend import PADS, call, read_json
from support.machine_files import CORPUS

from qlvbayes.io.checks import InputError
from qlvbayes.laws import check_law
from qlvbayes.laws.catalogue import LAWS, own_laws
from qlvbayes.laws.conformance import LawError

FIT = ("--pads", "B", "--method", "least-squares", "--noise", "white")

OWN = (CORPUS / "own" / "laws.txt").read_text("utf-8")


def check_all(laws):
    for kind in (*laws.elastic, *laws.relaxation):
        check_law(kind)


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "my_laws.py"
    path.write_text(OWN)
    return path


def test_laws_are_listed(own):
    status, out, _ = call("effects", "--laws", "--json", "--laws-file", own)
    assert status == 0
    listed = {(entry["option"], entry["name"]): entry for entry in json.loads(out)}
    for kind in LAWS.elastic:
        assert set(listed["--elastic", kind.name]["parameters"]) == set(kind.units)
    for kind in LAWS.relaxation:
        assert set(listed["--relaxation", kind.name]["parameters"]) == set(kind.units)
    assert listed["--elastic", "tangent"]["parameters"] == {"m": "N"}
    status, out, _ = call("effects", "--laws")
    assert (status, "power-law" in out, "alpha" in out) == (0, True, True)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (('"tangent"', '"hertz"'), "the law hertz comes with the package"),
        (("def stiffness", "def slope"), "the law Tangent lacks stiffness"),
        (('    reference: ClassVar[str] = "nobody"\n', ""), "the law Tangent lacks reference"),
        (("import jax.numpy", "import jax.nonsense"), "ModuleNotFoundError"),
    ],
)
def test_a_bad_file_is_refused_with_its_place(own, change, problem):
    own.write_text(OWN.replace(*change))
    with pytest.raises(InputError, match=problem) as caught:
        own_laws(own)
    assert str(own) in str(caught.value)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("0.5 * self.m / jnp.cos", "self.m / jnp.cos"), "stiffness is off the slope"),
        (("jnp.tan(0.5 * depth)", "(0.1 + jnp.tan(0.5 * depth))"), "force at zero depth"),
        (("force_stop, decay)\n\n\nclass", "force_stop, 2.0 * decay)\n\n\nclass"), "its integral"),
        (("1.0 - self.s]", "0.9 - self.s]"), "sum to 0.9"),
        (("[self.s, 1.0 - self.s]", "[1.5 + 0 * self.s, -0.5 + 0 * self.s]"), "is negative"),
        (('"tau": "time"}', '"tau": "parsec"}'), "no kind of unit"),
        (('"tau": "time"}', '"t": "time"}'), "units must name exactly"),
    ],
)
@pytest.mark.few(2)
def test_a_law_that_breaks_a_rule_is_told_which(own, change, problem):
    text = OWN.replace(*change)
    assert text != OWN
    own.write_text(text)
    with pytest.raises(LawError, match=problem):
        check_all(own_laws(own))


@pytest.mark.slow
def test_a_fit_with_laws_of_ones_own_is_saved_checked_and_reported(tmp_path, own):
    """From the command to the page, through every file between."""
    check_all(own_laws(own))
    out = tmp_path / "out"
    words = ("--elastic", "tangent", "--relaxation", "maxwell", "--laws-file", own)
    status, _, err = call("fit", PADS, "-o", out, *FIT, *words)
    assert status == 0, err
    found = read_json(out / "B" / "summary.json")["parameters"]
    assert list(found) == ["m", "s", "tau", "noise.white"]
    assert found["tau"]["unit"] == "s"
    assert [call(step, out)[0] for step in ("check", "report")] == [0, 0]
    page = (out / "report.html").read_text()
    assert all(text in page for text in ("g = s + (1 - s) exp(-t/tau)", "what stays"))
