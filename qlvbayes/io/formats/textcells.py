"""Numbers as the cells of a text write them: marks, thousands, hours and dates."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError

_MINUS = re.compile(r"[\u2212\u2012\u2013\ufe63\uff0d](?=[\d.,])")
_BETWEEN_THOUSANDS = re.compile(r"(?<=\d)[ \u00a0\u202f\u2009\u2007](?=\d{3}(?!\d))")
_CLOCK = re.compile(  # ISO 8601, or the date as in German
    r"(\d{4}-\d\d-\d\d[T ]|\d\d?\.\d\d?\.\d{4} )?(\d+):(\d\d):(\d\d([.,]\d+)?)(Z|[+-]\d\d:?\d\d)?"
)
_LIKE_NUMBER = re.compile(r"[+-]?(\d[\d.,]*|[.,]\d+)([eE][+-]?\d+)?|" + _CLOCK.pattern)
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--", "---"}


def plain_number(text: str) -> str:
    """Return numbers with ASCII's minus and without spaces at thousands: '1 234,5' -> '1234,5'."""
    return _BETWEEN_THOUSANDS.sub("", _MINUS.sub("-", text))


def is_like_number(cell: str) -> bool:
    """Return whether a cell may be a number, with whatever decimal mark, or a time of hh:mm:ss."""
    return _LIKE_NUMBER.fullmatch(cell) is not None


def is_number(cell: str) -> bool:
    """Return whether a cell is a number with a decimal point."""
    return _NUMBER.fullmatch(cell) is not None


def is_missing(cell: str) -> bool:
    """Return whether a cell is empty, or has a mark for no number."""
    return cell.lower() in _MISSING


def are_numbers(cells: Sequence[str], indices: Sequence[int]) -> bool:
    """Return whether there are numbers in all the cells at these indices."""
    return len(cells) > max(indices) and all(is_like_number(cells[index]) for index in indices)


def with_point(cell: str, decimal: str) -> str:
    """Return a cell with a decimal point; a date, hours, minutes and seconds become seconds."""
    if clock := _CLOCK.fullmatch(cell):
        date = (clock[1] or "1970-01-01").strip(" T")
        if "." in date:
            date = "-".join(part.zfill(2) for part in reversed(date.split(".")))
        days = np.datetime64(date).astype(int)
        minutes = 1440 * days + 60 * int(clock[2]) + int(clock[3])
        return f"{60 * minutes + float(clock[4].replace(',', '.')):.9f}"
    if len(decimal) == 2:
        cell = cell.replace(decimal[1], "")
    return cell.replace(decimal[0], ".")


def decimal_mark(cells: Iterable[str], file: Path) -> str:
    """Return the decimal mark; '.,' for points with commas at thousands, ',.' for the reverse."""
    marked = [cell for cell in cells if "." in cell or "," in cell]
    both = [cell for cell in marked if "." in cell and "," in cell]
    if both:
        last = {max(".,", key=cell.rfind) for cell in both}
        if len(last) == 1:
            mark = last.pop()
            return mark + (",." if mark == "." else ".,")[0]
    points = sum("." in cell for cell in marked)
    if not marked or points == len(marked):
        return "."
    if points:
        if all("." in c or re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})+", c) for c in marked):
            return ".,"
        raise InputError(
            "some numbers have a decimal point and some a decimal comma",
            file=file,
            remedy="export with one decimal mark",
        )
    if all(re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})+", cell) for cell in marked):
        raise InputError(
            f"'{marked[0]}' may be a decimal comma or a thousand",
            file=file,
            remedy="export with decimal points",
        )
    return ","
