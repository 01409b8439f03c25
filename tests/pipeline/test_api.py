"""The package's own names: guessable, typed, quick to import, and none hides a module."""

import ast
import importlib
import inspect
import itertools
import pkgutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import pytest
from support.endtoend import two_tests

import qlvbayes as q
from qlvbayes import effects, laws, priors
from qlvbayes.io import formats
from qlvbayes.model import noise
from qlvbayes.use import exports

MODULES = [one.name for one in pkgutil.walk_packages(q.__path__, "qlvbayes.")]
PARTS = [effects, exports, formats, laws, noise, priors]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return q.read_study(two_tests(tmp_path_factory.mktemp("api") / "two.csv"))


def test_nothing_hides_a_module_and_public_functions_name_their_parameters():
    """A module loaded by ``import a.b.c`` stays ``a.b.c``, also once all names are taken out."""
    modules = {name: importlib.import_module(name) for name in MODULES}
    for name in q.__all__:
        getattr(q, name)
    hidden = []
    for name, module in modules.items():
        parent, _, own = name.rpartition(".")
        if getattr(sys.modules[parent], own) is not module:
            hidden.append(name)
    assert len(modules) > 200
    assert not hidden
    found = {function.__qualname__: function for function in public_functions()}
    assert {"compare", "read_study", "check_effect", "Specimen.fit", "Fit.predict"} <= set(found)
    for name, function in found.items():
        wanted = [name for name in inspect.signature(function).parameters if name != "self"]
        assert documented(function) == wanted, name


def test_what_is_offered_is_there_and_is_what_type_checkers_see():
    tree = ast.parse(Path(q.__file__).read_text())
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in typed.body
        for alias in node.names
    }
    assert sorted(seen) == q.__all__
    assert len(q.__all__) < 40
    for name, (module, own) in seen.items():
        value = getattr(q, name)
        assert name in dir(q)
        if not isinstance(value, ModuleType):
            assert value is getattr(importlib.import_module(module), own)
    assert {name for name in dir(q) if not name.startswith("_")} == set(q.__all__)


def test_importing_loads_nothing_that_is_not_used():
    heavy = "arviz_stats", "emcee", "matplotlib", "pandas", "scipy", "xarray"
    code = f"import sys, qlvbayes; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_study_has_its_pads_by_name_and_a_fit_says_what_the_readme_asks_of_it(study):
    assert (list(study), len(study), "C" in study) == (["C"], 1, True)
    assert study["C"].experiment is study["C"].experiment
    assert repr([study, study["C"]]) == "[<study two.csv: C>, <pad C, 2 tests>]"
    with pytest.raises(q.InputError, match=r"no pad 'D'.*name one of: C"):
        study["D"]
    fit = study["C"].fit(method="least-squares", settings=q.Settings(seed=3))
    summary = fit.summary()
    with ThreadPoolExecutor(1) as executor:  # or any other
        again = study.fit(method="least-squares", settings=q.Settings(seed=3), client=executor)
    assert {pad: one.summary() for pad, one in again.items()} == {"C": summary}
    assert summary.settings == q.Settings(seed=3)
    assert str(summary).splitlines()[0].split()[:2] == ["m", f"{summary['m'].median:.4g}"]
    assert [one.trial.name for one in fit.predict()] == [t.name for t in fit.experiment.trials]
    assert {cell.test for cell in fit.check().cells} == {test.name for test in study["C"].pad.tests}
    groups = fit.inference_data
    assert groups["posterior"]["m"].shape == fit.constants.shape[:2]
    assert {"log_likelihood", "posterior_predictive", "observed_data"} <= set(groups.children)


@pytest.mark.parametrize(
    "given",
    [{"effects": "magic"}, {"effects": ("friction", "sharp_friction")}, {"fixed": {"v[7]": 1.0}},
     {"priors": {"m": priors.Normal(1.0, 1.0)}}, {"priors": {"q": priors.LogNormal(1.0, 1.0)}}],
)  # fmt: skip
def test_a_choice_that_cannot_be_used_is_refused_when_it_is_made(given):
    with pytest.raises(q.InputError):
        q.Choices(**given)


def documented(function):
    """Names in the section Parameters of a docstring (numpydoc)."""
    text = inspect.getdoc(function).partition("Parameters\n----------\n")[2]
    lines = itertools.takewhile(lambda line: not line.startswith("---"), text.splitlines())
    heads = [line for line in lines if line and not line.startswith(" ")]
    return [name for head in heads for name in head.split(", ") if name.islower()]


def public_functions():
    """Yield the functions at the top and in the parts, and the methods of what they return."""
    for module in (q, *PARTS):
        for name in module.__all__:
            if inspect.isfunction(value := getattr(module, name)):
                yield value
    for kind in (q.Specimen, q.Fit):
        for name, value in vars(kind).items():
            if inspect.isfunction(value) and not name.startswith("_"):
                yield value
