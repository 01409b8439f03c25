"""Hold what the user answers where files do not state it, and define the questions."""

from __future__ import annotations

import re
from dataclasses import dataclass

from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.formats.format import UnsureError
from qlvbayes.io.formats.layouts import named_columns
from qlvbayes.io.formats.machineunits import named_units
from qlvbayes.io.formats.naming import pattern_of

SIGNS = {"none": (1, 1), "displacement": (-1, 1), "force": (1, -1), "both": (-1, -1)}
"""Choices of the columns that change sign, with the factors of displacement and force."""
__all__ = ["FILE", "SIGNS", "Answers", "UnsureError"]
FILE = "file"  # value of --contact that stands for the file's own zero


@dataclass(frozen=True)
class Answers:
    """Answers that the user gives beforehand; None or empty where the files shall decide."""

    sign: str | None = None  # a key of ``SIGNS``
    # displacement at first contact, as the file writes it, or ``FILE``
    contact: float | str | None = None
    units: tuple[str, str, str] | None = None  # units of time, displacement and force
    area: float | None = None  # the specimen's area (mm2)
    pads: tuple[str, ...] = ()  # one name for all, one a file, or one a test
    tests: tuple[str, ...] = ()
    pad_from: re.Pattern[str] | None = None  # the pattern that finds a pad's name in a test's own
    # the columns of time, displacement and force, by name or by number from 1
    columns: tuple[str, str, str] | None = None

    @classmethod
    def from_words(
        cls,
        sign: str | None = None,
        contact: str | None = None,
        units: str | None = None,
        area: float | None = None,
        pads: tuple[str, ...] = (),
        tests: tuple[str, ...] = (),
        pad_from: str | None = None,
        columns: str | None = None,
    ) -> Answers:
        """Return answers from the words of the command line."""
        if sign is not None:
            check_known("sign", sign, SIGNS)
        if area is not None and not area > 0.0:
            raise InputError(f"the area {area:g} is not positive", remedy="give it in mm2")
        position = None if contact is None else _position(contact)
        named = None if units is None else named_units(units)
        if pad_from is not None and pads:
            remedy = "give one of them"
            raise InputError("--pad and --pad-from both name the pads", remedy=remedy)
        pattern = None if pad_from is None else pattern_of(pad_from)
        chosen = None if columns is None else named_columns(columns)
        return cls(sign, position, named, area, pads, tests, pattern, chosen)


def _position(text: str) -> float | str:
    if text == FILE:
        return FILE
    try:
        return float(text)
    except ValueError:
        remedy = f"give it in the unit of the tidy file, or '{FILE}' for the file's own zero"
        raise InputError(f"no position of contact {text!r}", remedy=remedy) from None
