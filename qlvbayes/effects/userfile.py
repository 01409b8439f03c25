"""Effects from a Python file of the user's own."""

from __future__ import annotations

import inspect
from pathlib import Path

from qlvbayes.checks import InputError
from qlvbayes.effects.catalogue import EVERY, names
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.usermodule import own_classes


def load(path: str | Path) -> tuple[type[AbstractEffect], ...]:
    """The effects that a Python file defines, in its order; those it imports do not count.

    Raises
    ------
    InputError
        The file is missing, stops with an error, defines no effect, one that lacks a part, or a
        name that another effect has.
    """
    path = Path(path)
    found = own_classes(path, AbstractEffect, "effects")  # type: ignore[type-abstract]
    if not found:
        raise InputError(
            "defines no effect", file=path, remedy="write a class that extends AbstractEffect"
        )
    taken = dict.fromkeys(names(EVERY), "comes with the package")
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
