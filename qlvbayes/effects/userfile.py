"""Effects from a Python file of the user's own."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.effects.catalogue import EVERY, names
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.checks import InputError
from qlvbayes.io.usermodule import check_own, own_classes


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
    taken = {name: f"an effect called {name} comes with the package" for name in names(EVERY)}
    for kind in found:
        check_own(path, kind, AbstractEffect, "effect", taken)
        taken[kind.name] = f"an effect called {kind.name} stands in this file already"
    return found
