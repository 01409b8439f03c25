"""Formats from a Python file of the user's own."""

from __future__ import annotations

from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.catalogue import FORMATS
from qlvbayes.io.formats.format import AbstractFormat
from qlvbayes.io.usermodule import check_own, own_classes


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
    said = "there is a format called {} already"
    taken = {kind.name: said.format(kind.name) for kind in FORMATS}
    for kind in found:
        check_own(path, kind, AbstractFormat, "format", taken)
        taken[kind.name] = said.format(kind.name)
    return found
