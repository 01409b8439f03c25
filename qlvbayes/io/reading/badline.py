"""Find the first faulty line in a block that the fast reader refused."""

from __future__ import annotations

import math
import re
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.reading.dialect import Dialect, split_row

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_SWAP = str.maketrans(",.", ".,")
_WRITE = "write a number or delete the row"
_MISSING = {"", "na", "n/a", "nan", "null", "none", "-"}
_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)


def is_content(text: str) -> bool:
    """Return whether a line holds a row: neither blank nor a comment."""
    return bool(text.strip()) and not text.startswith("#")


def first_fault(block: bytes, first_line: int, dialect: Dialect, file: Path) -> InputError:
    """Return the error of the first line that is not a good row."""
    lines = block.decode("utf-8").split("\n")
    for line, text in enumerate(lines, first_line):
        if line <= dialect.header_line or not is_content(text):
            continue
        if (fault := _fault(text, dialect)) is not None:
            message, remedy = fault
            return InputError(message, file=file, line=line, remedy=remedy)
    return InputError(
        "the rows from here on cannot be read",
        file=file,
        line=max(first_line, dialect.header_line + 1),
        remedy="write plain numbers, without quotation marks",
    )


def parse_number(text: str, decimal: str) -> float | None:
    """Return the number in a cell, or None."""
    if decimal == ",":
        text = text.translate(_SWAP)
    return float(text) if _NUMBER.fullmatch(text) else None


def _fault(text: str, dialect: Dialect) -> tuple[str, str] | None:
    if text.count('"') % 2:
        return "a quotation mark is not closed", "remove it"
    if _stray_quote(text, dialect.separator):
        return "there is a quotation mark within a field", "remove it"
    cells = split_row(text, dialect.separator)
    if cells == [text] and dialect.separator in text:
        return "a field is too long to be read", "shorten it"
    if len(cells) != dialect.columns.width:
        fields = "1 field" if len(cells) == 1 else f"{len(cells)} fields"
        what = f"the row has {fields} and the header {dialect.columns.width}"
        return what, "complete or delete the row"
    for column in dialect.columns.numeric.values():
        cell = cells[column.index]
        value = parse_number(cell, dialect.decimal)
        if value is None:
            return _not_a_number(column.name, cell, dialect.decimal)
        if not math.isfinite(value):
            return f"{column.name} is not finite ('{cell[:40]}')", _WRITE
    return None


def _not_a_number(name: str, cell: str, decimal: str) -> tuple[str, str]:
    if not cell:
        return f"{name} is empty", _WRITE
    if cell.lower() in _MISSING:
        return f"{name} is missing ('{cell}')", _WRITE
    if _INFINITE.fullmatch(cell):
        return f"{name} is not finite ('{cell}')", _WRITE
    other = "." if decimal == "," else ","
    if parse_number(cell, other) is not None:
        mark = "decimal comma" if other == "," else "decimal point"
        return (
            f"{name} has a {mark} ('{cell}')",
            f"write '{decimal}' as the decimal mark throughout",
        )
    return f"{name} is not a number ('{cell[:40]}')", _WRITE


def _stray_quote(text: str, separator: str) -> bool:
    """Return whether a quotation mark opens anywhere but at the start of a field."""
    opening = text.split('"')[:-1:2]
    return any(part and part[-1] not in (separator, " ") for part in opening)
