"""Formats from a Python file of the user's own."""

from __future__ import annotations

import inspect
from pathlib import Path

from qlvbayes.checks import InputError
from qlvbayes.formats.catalogue import FORMATS
from qlvbayes.formats.format import AbstractFormat
from qlvbayes.usermodule import own_classes


def load(path: Path) -> tuple[type[AbstractFormat], ...]:
    """The formats that a Python file defines, in its order; those it imports do not count.

    Raises
    ------
    InputError
        The file is missing, stops with an error, defines no format, one that lacks a part, or a
        name that another format has.
    """
    found = own_classes(path, AbstractFormat, "formats")  # type: ignore[type-abstract]
    if not found:
        raise InputError(
            "defines no format", file=path, remedy="write a class that extends AbstractFormat"
        )
    taken = {kind.name for kind in FORMATS}
    for kind in found:
        line = inspect.getsourcelines(kind)[1]
        lacking = sorted(kind.__abstractmethods__) if inspect.isabstract(kind) else []
        lacking += [word for word in AbstractFormat.__annotations__ if not hasattr(kind, word)]
        if lacking:
            raise InputError(
                f"the format {kind.__name__} lacks {', '.join(lacking)}",
                file=path,
                line=line,
                remedy="define them in the class",
            )
        if kind.name in taken:
            raise InputError(
                f"there is a format called {kind.name} already",
                file=path,
                line=line,
                remedy="choose another name",
            )
        taken.add(kind.name)
    return found
