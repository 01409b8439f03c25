"""Effects from a Python file of the user's own."""

from __future__ import annotations

import importlib.util
import inspect
import sys
import traceback
from pathlib import Path
from types import ModuleType

from qlvbayes.checks import InputError
from qlvbayes.effects.catalogue import EFFECTS, names
from qlvbayes.effects.effect import AbstractEffect


def load(path: str | Path) -> tuple[type[AbstractEffect], ...]:
    """The effects that a Python file defines, in its order; those it imports do not count.

    Raises
    ------
    InputError
        The file is missing, stops with an error, defines no effect, one that lacks a part, or a
        name that another effect has.
    """
    path = Path(path)
    if path.suffix != ".py" or not path.is_file():
        raise InputError(
            "no such Python file", file=path, remedy="give the path of a .py file with effects"
        )
    module = _imported(path)
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind)
        and issubclass(kind, AbstractEffect)
        and kind.__module__ == module.__name__
    ]
    found = tuple(dict.fromkeys(kind for kind in kinds if not kind.__name__.startswith("Abstract")))
    if not found:
        raise InputError(
            "defines no effect", file=path, remedy="write a class that extends AbstractEffect"
        )
    taken = dict.fromkeys(names(EFFECTS), "comes with the package")
    for kind in found:
        _check(kind, taken, path)
        taken[kind.name] = "stands in this file already"
    return found


def _check(kind: type[AbstractEffect], taken: dict[str, str], path: Path) -> None:
    line = inspect.getsourcelines(kind)[1]
    lacking = sorted(kind.__abstractmethods__) if inspect.isabstract(kind) else []
    lacking += [word for word in AbstractEffect.__annotations__ if not hasattr(kind, word)]
    if lacking:
        raise InputError(
            f"the effect {kind.__name__} lacks {', '.join(lacking)}",
            file=path,
            line=line,
            remedy="define them in the class",
        )
    if kind.name in taken:
        raise InputError(
            f"an effect called {kind.name} {taken[kind.name]}",
            file=path,
            line=line,
            remedy="choose another name",
        )


def _imported(path: Path) -> ModuleType:
    """The file as a module, under a name that no other has."""
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
    """The last line of the file on the error's way."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return error.lineno
    steps = traceback.extract_tb(error.__traceback__)
    lines = [step.lineno for step in steps if step.filename == str(path)]
    return lines[-1] if lines else None
