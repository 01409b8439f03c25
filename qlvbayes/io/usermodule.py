"""Import classes from a user's own Python file."""

from __future__ import annotations

import importlib.util
import inspect
import sys
import traceback
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from qlvbayes.io.checks import InputError

Kind = TypeVar("Kind")


def own_classes(path: Path, base: type[Kind], content: str) -> tuple[type[Kind], ...]:
    """Return the classes under ``base`` that a file defines, in its order."""
    module = _own_module(path, content)
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, base) and kind.__module__ == module.__name__
    ]
    return tuple(dict.fromkeys(kind for kind in kinds if not kind.__name__.startswith("Abstract")))


def own_values(path: Path, kind: type[Kind]) -> list[Kind]:
    """Return the values of a class that a file assigns to names of its own, in its order."""
    module = _own_module(path, f"values of {kind.__name__}")
    return [value for value in vars(module).values() if isinstance(value, kind)]


def _own_module(path: Path, content: str) -> ModuleType:
    if path.suffix != ".py" or not path.is_file():
        raise InputError(
            "no such Python file", file=path, remedy=f"give the path of a .py file with {content}"
        )
    status = path.stat()
    return _module(path, status.st_mtime_ns, status.st_size)


def check_own(
    path: Path, kinds: Iterable[type[Any]], base: type[Any], word: str, known: Iterable[str]
) -> None:
    """Raise InputError where a class of a file lacks a part of ``base``, or its name is used."""
    taken = dict.fromkeys(known, "comes with the package")
    for kind in kinds:
        _check_one(path, kind, base, word, taken)
        taken[kind.name] = "is in this file already"


def _check_one(
    path: Path, kind: type[Any], base: type[Any], word: str, taken: Mapping[str, str]
) -> None:
    line = inspect.getsourcelines(kind)[1]
    missing = sorted(kind.__abstractmethods__) if inspect.isabstract(kind) else []
    missing += [name for name in base.__annotations__ if not hasattr(kind, name)]
    if missing:
        raise InputError(
            f"the {word} {kind.__name__} lacks {', '.join(missing)}",
            file=path,
            line=line,
            remedy="define them in the class",
        )
    if kind.name in taken:
        raise InputError(
            f"the {word} {kind.name} {taken[kind.name]}",
            file=path,
            line=line,
            remedy="choose another name",
        )


@lru_cache(maxsize=16)
def _module(path: Path, changed: int, size: int) -> ModuleType:
    """Return the file as a module; the cache is keyed by its size and time of change."""
    return _imported(path)


def _imported(path: Path) -> ModuleType:
    """Return the file as a module under a unique name."""
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
