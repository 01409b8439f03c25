"""List what users choose by name, and find what they add: in files of their own, or installed.

The lists have the path of each class, so that the help of a command does not wait for JAX. A name
on the left is the ``name`` of the class on the right. Limits are those that a help or a first look
states.

A package that states, in its ``pyproject.toml``,

.. code-block:: toml

    [project.entry-points."qlvbayes.effects"]
    quadratic_drag = "our_lab_effects:QuadraticDrag"

adds an effect; the groups ``qlvbayes.laws`` and ``qlvbayes.formats`` add laws and formats
(https://packaging.python.org/specifications/entry-points). What is found is checked by the rules
for such a class, once for each version of the package, and refused by its name where it breaks one.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import sys
import traceback
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cache, lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.files import write_whole
from qlvbayes.io.runtime import cache_folder

ELASTIC = {
    "exponential": "laws.elastic.exponential.Exponential",
    "linear": "laws.elastic.polynomial.Linear",
    "hertz": "laws.elastic.polynomial.HertzPower",
    "polynomial:2": "laws.elastic.polynomial.Quadratic",
    "polynomial:3": "laws.elastic.polynomial.Cubic",
    "toe": "laws.elastic.exponential.ToeExponential",
    "spline": "laws.elastic.spline.Spline",
}
"""Elastic laws. Constants alone show `model.drawn` which law they are of: the first whose
constants are all there. So a law comes before those whose constants are all among its own."""
RELAXATION = {
    "prony": "laws.relaxation.prony.Prony",
    "fung": "laws.relaxation.continuous.Fung",
    "power-law": "laws.relaxation.continuous.PowerLaw",
    "stretched": "laws.relaxation.continuous.StretchedExponential",
    "log-normal": "laws.relaxation.continuous.LogNormalSpectrum",
}
"""Relaxations, ordered likewise."""
NOISES = {
    "floor": "model.noise.Floor",
    "white": "model.noise.White",
}
"""Noise models, ordered likewise; the first is the default."""
SAMPLERS = {"emcee": "fitting.ensemble.sample"}
"""Functions that sample the posterior of constants."""
METHODS = (*SAMPLERS, "least-squares", "two-step")
"""Ways to the constants."""
TARGETS = {
    "c": "use.exports.code.CHeader",
    "fmu": "use.exports.code.Fmu",
    "mujoco": "use.exports.simulators.MuJoCo",
    "drake": "use.exports.simulators.Drake",
    "matlab": "use.exports.code.MatlabFunction",
    "abaqus": "use.exports.finite_elements.Abaqus",
    "febio": "use.exports.finite_elements.FEBio",
    "prony": "use.exports.finite_elements.PronyTable",
    "curves": "use.exports.curves.ViscoelasticCurves",
    "json": "use.exports.json_file.JsonFile",
}
"""Targets of an export, in the order in which they are shown."""

MOST_MODES = 6  # of a Prony series; no test resolves more
MOST_TESTS = 5  # in a series of proposed tests
SLOWEST_HZ = 2.0  # of a frame that rings: that of a soft testing machine
READINGS_A_PERIOD = 4.0  # which show a frequency
EXPORT_DRAWS = 64  # of the posterior: a 90 % interval from them is off by a few per cent of them


def loaded(paths: Mapping[str, str]) -> dict[str, Any]:
    """Import what the paths lead to, by name."""
    return {name: at(path) for name, path in paths.items()}


def at(path: str) -> Any:
    """Import one class or function by its path within the package, as ``io.data.Pad``."""
    module, _, name = path.rpartition(".")
    return getattr(importlib.import_module(f"qlvbayes.{module}"), name)


# What users add

EFFECT_POINTS, LAW_POINTS, FORMAT_POINTS = (
    f"qlvbayes.{name}" for name in ("effects", "laws", "formats")
)
_CHECKED = "checked.json"  # which versions of which entry points passed the rules
Kind = TypeVar("Kind")
Check = tuple[str, Callable[[], None]]
"""Name of a rule, and the function that raises an error where the rule is broken."""


def run_checks(checks: Iterable[Check], error: type[AssertionError]) -> None:
    """Run all checks, and raise one error that lists every broken rule, a line each."""
    broken: list[str] = []
    for number, (_, check) in enumerate(checks):
        try:
            check()
        except error as problem:
            broken.append(str(problem))
            if number == 0:
                break
        except Exception:
            if not broken:
                raise
            break  # what is broken already is the reason
    if broken:
        raise error("\n".join(broken))


@cache
def points(group: str) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group, in the order of their names."""
    return tuple(sorted(entry_points(group=group), key=lambda point: point.name))


def installed(
    group: str, word: str, known: Collection[str], check: Callable[[Any], None]
) -> tuple[Any, ...]:
    """Return what installed packages add to a group.

    ``word`` is what its members are called, ``known`` are names that are taken, and ``check``
    raises an error whose text says which rule is broken. An InputError says which entry point
    cannot be loaded, has a name that is taken, or breaks a rule.
    """
    found, taken = [], set(known)
    for point in points(group):
        try:
            kind = point.load()
        except Exception as error:  # whatever another's code raises
            raise _refused(point, word, f"{type(error).__name__}: {error}") from error
        name = getattr(kind, "name", point.name)
        if name in taken:
            raise _refused(point, word, f"the name {name} is taken")
        taken.add(name)
        version = point.dist.version if point.dist else ""
        key = f"{point.group} {point.value} {version}"
        if key not in _passed():
            try:
                check(kind)
            except Exception as error:  # whatever another's code raises
                raise _refused(point, word, str(error) or type(error).__name__) from error
            _remember(key)
        found.append(kind)
    return tuple(found)


def _refused(point: EntryPoint, word: str, why: str) -> InputError:
    """Return the error that names an entry point and its package."""
    package = point.dist.name if point.dist else point.module
    return InputError(
        f"the {word} {point.name} of the installed package {package} cannot be used: "
        f"{' '.join(why.split())}",
        remedy=f"install a version that keeps the rules, or pip uninstall {package}",
    )


def _passed() -> list[str]:
    """Return the keys of what passed the rules before."""
    try:
        known = json.loads((cache_folder().parent / _CHECKED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    return known if isinstance(known, list) else []


def _remember(key: str) -> None:
    """Keep that an entry point passed; a folder that cannot be written to costs another check."""
    path = cache_folder().parent / _CHECKED
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps([*_passed(), key]).encode())
    except OSError:
        return


def own_classes(path: Path, base: type[Kind], content: str) -> tuple[type[Kind], ...]:
    """Return the classes under ``base`` that a user's file defines, in its order."""
    module = own_module(path, content)
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, base) and kind.__module__ == module.__name__
    ]
    return tuple(dict.fromkeys(kind for kind in kinds if not kind.__name__.startswith("Abstract")))


def check_own(
    path: Path, kinds: Iterable[type[Any]], base: type[Any], word: str, known: Iterable[str]
) -> None:
    """Raise InputError where a class of a file lacks a part of ``base``, or its name is used."""
    taken = dict.fromkeys(known, "comes with the package")
    for kind in kinds:
        line = inspect.getsourcelines(kind)[1]
        missing = sorted(kind.__abstractmethods__) if inspect.isabstract(kind) else []
        missing += [name for name in base.__annotations__ if not hasattr(kind, name)]
        if missing:
            what = f"the {word} {kind.__name__} lacks {', '.join(missing)}"
            raise InputError(what, file=path, line=line, remedy="define them in the class")
        if kind.name in taken:
            what = f"the {word} {kind.name} {taken[kind.name]}"
            raise InputError(what, file=path, line=line, remedy="choose another name")
        taken[kind.name] = "is in this file already"


def own_module(path: Path, content: str) -> ModuleType:
    """Return a user's file as a module; ``content`` is what it is to have."""
    if path.suffix != ".py" or not path.is_file():
        raise InputError(
            "no such Python file", file=path, remedy=f"give the path of a .py file with {content}"
        )
    status = path.stat()
    return _module(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)
def _module(path: Path, changed: int, size: int) -> ModuleType:
    """Return the file as a module under a unique name; one that changed is imported anew."""
    name = f"qlvbayes_user_{abs(hash(str(path.resolve())))}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look up a class's own module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise InputError(
            f"{type(error).__name__}: {error}",
            file=path,
            line=_line(error, path),
            remedy="run the file with python to see more",
        ) from error
    return module


def _line(error: Exception, path: Path) -> int | None:
    """Return the last line of the file in the error's traceback."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return error.lineno
    steps = traceback.extract_tb(error.__traceback__)
    lines = [step.lineno for step in steps if step.filename == str(path)]
    return lines[-1] if lines else None
