"""Classes from a Python file of the user's own."""

from __future__ import annotations

import importlib.util
import inspect
import sys
import traceback
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from qlvbayes.io.checks import InputError

Kind = TypeVar("Kind")


def own_classes(path: Path, base: type[Kind], content: str) -> tuple[type[Kind], ...]:
    """The classes under ``base`` that a file defines, in its order; imported ones do not count.

    Classes called Abstract... are left out; an unchanged file gives the same classes again, so
    that what was compiled for them is used. content: of the file, for a message. Raises InputError
    where there is no such file or it stops with an error.
    """
    if path.suffix != ".py" or not path.is_file():
        raise InputError(
            "no such Python file", file=path, remedy=f"give the path of a .py file with {content}"
        )
    facts = path.stat()
    module = _module(path, facts.st_mtime_ns, facts.st_size)
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, base) and kind.__module__ == module.__name__
    ]
    return tuple(dict.fromkeys(kind for kind in kinds if not kind.__name__.startswith("Abstract")))


def check_own(
    path: Path, kind: type[Any], base: type[Any], word: str, taken: Mapping[str, str]
) -> None:
    """Raise InputError where a class lacks a part of ``base``, or its name is taken.

    word: what the class is; taken: what to say of each name that is.
    """
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
        raise InputError(taken[kind.name], file=path, line=line, remedy="choose another name")


@lru_cache(maxsize=16)
def _module(path: Path, changed: int, size: int) -> ModuleType:
    """The file as it was when it was changed last."""
    return _imported(path)


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
