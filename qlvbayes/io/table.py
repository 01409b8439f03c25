"""Read tables of text: rows of cells to columns of numbers and labels.

Tidy files, machines' text and the sheets of workbooks all pass `read_rows`. pandas reads rows that
are all good. Where one may be bad, a slower way looks at each line: it refuses the first bad row of
a tidy file, and leaves out and counts the lines of a machine's file that are no rows.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.text import CLOCK, cells_of, hour_of_day, is_like_number

SHOWN = 60  # characters of a line that an error shows
LARGEST_SHARE = 0.02  # share of a test's readings that may be bad; with more it is not reliable
EXPORT = "export the measurements again"
_NO_ROW = re.compile(rb"(?m)^(#.*|[ \t]*)\n")  # a comment or a blank line of a tidy file
_MINUS = re.compile(r"[\u2212\u2012\u2013\ufe63\uff0d](?=[\d.,])")
_BETWEEN_THOUSANDS = re.compile(r"(?<=\d)[ \u00a0\u202f\u2009\u2007](?=\d{3}(?!\d))")
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--", "---"}
_SAMPLE = 400  # rows from which the decimal mark is taken where all the others agree
_DAY = 86400.0  # s
_FOOTER, _SUMMED = 8, 3  # lines at the end in which a summary may stand, and its most rows
_NO_NUMBERS, _EMPTY = "lines without numbers", "rows with an empty cell"


# Cells


def plain_number(text: str) -> str:
    """Return numbers with ASCII's minus and without spaces at thousands: '1 234,5' -> '1234,5'."""
    return _BETWEEN_THOUSANDS.sub("", _MINUS.sub("-", text))


def are_numbers(cells: Sequence[str], indices: Sequence[int]) -> bool:
    """Return whether there are numbers in all the cells at these indices."""
    return len(cells) > max(indices) and all(is_like_number(cells[index]) for index in indices)


def parse_number(text: str, decimal: str) -> float | None:
    """Return the number in a cell, or None."""
    if decimal == ",":
        text = text.translate(str.maketrans(",.", ".,"))
    return float(text) if _NUMBER.fullmatch(text) else None


def with_point(cell: str, decimal: str) -> str:
    """Return a cell with a decimal point; hours, minutes and seconds become seconds."""
    if clock := CLOCK.fullmatch(cell):
        hour = hour_of_day(int(clock[2]), clock["half"])
        minutes = 60 * hour + int(clock[3])  # the rows tell where a day ends
        return f"{60 * minutes + float(clock[4].replace(',', '.')):.9f}"
    if len(decimal) == 2:
        cell = cell.replace(decimal[1], "")
    return cell.replace(decimal[0], ".")


def decimal_mark(cells: Iterable[str], file: Path) -> str:
    """Return the decimal mark; '.,' for points with commas at thousands, ',.' for the reverse."""
    marked = [cell for cell in cells if "." in cell or "," in cell]
    last = {max(".,", key=cell.rfind) for cell in marked if "." in cell and "," in cell}
    if len(last) == 1:
        return ".," if last == {"."} else ",."
    points = sum("." in cell for cell in marked)
    grouped = all("." in cell or THOUSANDS.fullmatch(cell) for cell in marked)
    if points == len(marked):
        return "."
    if points and grouped:
        return ".,"
    if not points and not grouped:
        return ","
    what = f"'{marked[0]}' may be a decimal comma or a thousand"
    if points:
        what = "some numbers have a decimal point and some a decimal comma"
    raise InputError(what, file=file, remedy="export with decimal points")


# Rows


@dataclass(frozen=True)
class RowForm:
    """Form of the rows of a table, and the columns that are read of it.

    ``numbers`` are the indices and names of the columns of numbers, ``labels`` the indices of texts
    that change rarely. A tidy file states its ``width``, the number of its columns: each of its
    lines is a row. ``names`` is how many columns the names above a machine's table count, and
    ``decimal`` is None where its rows have to show it.
    """

    separator: str
    numbers: Sequence[tuple[int, str]]
    labels: Sequence[int] = ()
    width: int | None = None
    decimal: str | None = None
    names: int | None = None

    @property
    def indices(self) -> list[int]:
        """Return the indices of the numbers."""
        return [index for index, _ in self.numbers]


@dataclass(frozen=True, eq=False)
class Labels:
    """Texts of a column: codes (n,) are indices into ``texts``."""

    codes: NDArray[np.intp]
    texts: list[str]

    @classmethod
    def from_texts(cls, written: Iterable[str] | pd.Series) -> Labels:
        """Return the labels of a column; blanks around a text do not count."""
        codes, unique = pd.factorize(pd.Series(written, dtype=object))
        known: dict[str, int] = {}
        common = [known.setdefault(str(text).strip(), len(known)) for text in unique]
        return cls(np.array(common, dtype=np.intp)[codes], list(known))


@dataclass(frozen=True, eq=False)
class Rows:
    """Columns of numbers, each (n,), and of labels; counts of dropped lines, by reason.

    ``clocks`` has the positions, among the columns, of those written as hours, minutes and seconds,
    each with its first cell; they are in s since that day began. ``line`` gives the line of the
    file, from 1, that holds a row.
    """

    columns: tuple[Floats, ...]
    labels: tuple[Labels, ...]
    dropped: dict[str, int]
    line: Callable[[int], int]
    clocks: Mapping[int, str] = field(default_factory=dict)


def read_rows(data: bytes, form: RowForm, file: Path, first: int = 1) -> Rows:
    """Return the columns of the rows in a text, of which the first line is ``first`` of the file.

    An InputError names the first bad row of a tidy file, and the first lost one of a table that
    loses more than 2 % of its rows. Cells may be empty, as a logger of two rates leaves them.
    """
    dropped: dict[str, int] = {}
    rows = data if data.endswith(b"\n") else data + b"\n"
    if form.width is None:
        rows = _without_cut(data, form, dropped)
        if not rows.isascii() or re.search(rb"\d \d{3}", rows):
            rows = plain_number(rows.decode("utf-8", "replace")).encode()
    elif any(b"\n" + sign in b"\n" + rows for sign in (b"#", b"\n", b" ", b"\t")):
        rows = _NO_ROW.sub(b"", rows)
    if not rows.strip():
        raise InputError("there are no rows of numbers", file=file, remedy=EXPORT)
    cells = cells_of(rows.lstrip().partition(b"\n")[0].decode("utf-8", "replace"), form.separator)
    whole = all(cell.lstrip("+-").isdecimal() for cell in cells)
    if form.separator == "," and form.names is not None and len(cells) > form.names and whole:
        raise InputError(
            f"{len(cells)} numbers are below {form.names} names: the comma separates columns and "
            "marks decimals",
            file=file,
            line=first,
            remedy="export with semicolons or tabs between the columns, or with decimal points",
        )
    try:
        found = _fast(rows, form, file)
    except ValueError:  # a cell is no number
        found = None
    if found is None:
        return _judged(rows if form.width is None else data, form, file, first, dropped)

    def line(row: int) -> int:
        lines = enumerate(data.split(b"\n"), first)
        whole = (n for n, text in lines if text.strip() and not text.startswith(b"#"))
        return next(islice(whole, row, None))

    return Rows(*found, dropped, line)


def _without_cut(data: bytes, form: RowForm, dropped: dict[str, int]) -> bytes:
    """Return rows without a last line that does not end, and lacks cells or digits."""
    above, _, last = data.rstrip(b" \t").rpartition(b"\n")
    if last and above and last.count(form.separator.encode()) <= max(form.indices):
        before = above[above.rfind(b"\n") + 1 :]
        fewer = any(last.count(mark) < before.count(mark) for mark in (b",", b";", b"\t", b'"'))
        digits = [re.search(rb"[.,](\d*)\D*$", line) for line in (before, last)]
        decimals = [len(found[1]) if found else 0 for found in digits]
        if fewer or decimals[1] < decimals[0]:
            dropped["cut last line"] = 1
            return above + b"\n"
    return data if data.endswith(b"\n") else data + b"\n"


def _fast(
    rows: bytes, form: RowForm, file: Path
) -> tuple[tuple[Floats, ...], tuple[Labels, ...]] | None:
    """Return the columns of rows that are all good; None where one may not be."""
    whole = rows.strip(b"\n")
    head = whole.split(b"\n", _SAMPLE)[:_SAMPLE]
    sample = [cells_of(line.decode("utf-8", "replace"), form.separator) for line in head]
    width = form.width or max(len(sample[0]), max(form.indices) + 1)
    count = whole.count(b"\n") + 1
    even = whole.count(form.separator.encode()) == count * (width - 1)
    if len(sample[0]) < width or b"\n\n" in whole or (form.width is not None and not even):
        return None
    used = [[row[k] for k in form.indices if k < len(row)] for row in sample]
    if any(":" in cell for cell in used[0]):  # a time of the day
        return None
    decimal = form.decimal or decimal_mark((cell for row in used for cell in row), file)
    # pandas takes a column of nothing but True and False for ones and zeros
    if any(_NUMBER.fullmatch(with_point(cell, decimal)) is None for cell in used[0]):
        return None
    frame = pd.read_csv(
        io.BytesIO(whole),
        engine="c",
        header=None,
        names=list(range(width)),
        index_col=False,
        usecols=sorted({*form.indices, *form.labels}),
        dtype=dict.fromkeys(form.indices, float) | dict.fromkeys(form.labels, object),
        sep=form.separator,
        decimal=decimal[0],
        thousands=decimal[1:] or None,
        skipinitialspace=True,
        na_filter=False,
        low_memory=False,
        on_bad_lines="skip",
    )
    if len(frame) != count:
        return None
    labels = tuple(Labels.from_texts(frame[index]) for index in form.labels)
    columns = tuple(np.array(frame[index], dtype=np.float64) for index in form.indices)
    return (columns, labels) if all(np.isfinite(one).all() for one in columns) else None


def _fault(text: str, cells: Sequence[str], form: RowForm) -> tuple[str, str] | None:
    """Return why a line of a tidy file is no good row, and the remedy; None where it is one."""
    decimal, write = form.decimal or ".", "write a number or delete the row"
    if text.count('"') % 2:
        return "a quotation mark is not closed", "remove it"
    if any(part and part[-1] not in (form.separator, " ") for part in text.split('"')[:-1:2]):
        return "there is a quotation mark within a field", "remove it"
    if len(cells) != form.width:
        fields = "1 field" if len(cells) == 1 else f"{len(cells)} fields"
        what = f"the row has {fields} and the header {form.width}"
        return what, "complete or delete the row"
    for index, name in form.numbers:
        cell, other = cells[index], "," if decimal == "." else "."
        value = parse_number(cell, decimal)
        if value is not None and math.isfinite(value):
            continue
        what = "is not a number"
        if not cell:
            return f"{name} is empty", write
        if cell.lower() in _MISSING:
            what = "is missing"
        elif value is not None or _INFINITE.fullmatch(cell):
            what = "is not finite"
        elif parse_number(cell, other) is not None:
            what = "has a decimal comma" if other == "," else "has a decimal point"
            write = f"write '{decimal}' as the decimal mark throughout"
        return f"{name} {what} ('{cell[:40]}')", write
    return None


def _judged(rows: bytes, form: RowForm, file: Path, first: int, dropped: dict[str, int]) -> Rows:
    """Return rows line by line: a bad one of a tidy file is refused, and others are counted."""
    lines = rows.decode("utf-8", "replace").split("\n")
    found: dict[int, list[str]] = {}  # cells by the line's position
    lost: dict[int, str] = {}
    width = 0
    for position, line in enumerate(lines):
        if not line.strip() or (form.width is not None and line.startswith("#")):
            continue
        cells = cells_of(line, form.separator)
        if form.width is not None and (fault := _fault(line, cells, form)) is not None:
            raise InputError(fault[0], file=file, line=first + position, remedy=fault[1])
        if (why := _why_not(cells, form.indices, width)) is None:
            found[position] = cells
            width = width or len(cells)
        else:
            lost[position] = why
    used = {p: [cells[k] for k in form.indices] for p, cells in found.items()}
    marked = (cell for row in used.values() for cell in row if ":" not in cell)
    decimal = form.decimal or decimal_mark(marked, file)
    numbers: dict[int, list[float]] = {}
    for position, row in used.items():
        pointed = [with_point(cell, decimal) for cell in row]
        if all(map(_NUMBER.fullmatch, pointed)):
            numbers[position] = [float(cell) for cell in pointed]
        else:
            lost[position] = _NO_NUMBERS
    end = _end_of_table(lines, form, list(numbers))
    if below := sum(position >= end for position in numbers):
        dropped["rows of numbers below the table"] = below
    numbers = {p: row for p, row in numbers.items() if p < end}
    lost = {p: why for p, why in lost.items() if p < end}
    positions = list(numbers)
    within = [p for p in lost if positions and positions[0] < p < positions[-1]]
    bad = [p for p in within if lost[p] != _EMPTY] if positions else sorted(lost)
    if len(bad) > max(LARGEST_SHARE * (len(positions) + len(within)), 1.0) or not positions:
        shown = lines[min(bad)].strip()[:SHOWN] if bad else ""
        what = f"there are no rows of numbers (the first line is '{shown}')"
        if positions:
            what = f"{len(bad)} of {len(positions) + len(within)} rows have no number in a column "
            what += f"that is used, the first is '{shown}'"
        line_of = first + min(bad) if bad else None
        remedy = f"write numbers there or delete the rows, or {EXPORT}"
        raise InputError(what, file=file, line=line_of, remedy=remedy)
    for position, why in lost.items():
        if why != _EMPTY or position in within:
            dropped[why] = dropped.get(why, 0) + 1
    columns = list(np.array(list(numbers.values())).T)
    clocks = {k: cell for k, cell in enumerate(used[positions[0]]) if ":" in cell}
    for k in clocks:  # past midnight, where no date is written
        columns[k] = columns[k] + _DAY * np.cumsum(np.diff(columns[k], prepend=0.0) < -0.5 * _DAY)
    labels = tuple(
        Labels.from_texts([found[p][k] if k < len(found[p]) else "" for p in positions])
        for k in form.labels
    )
    return Rows(tuple(columns), labels, dropped, lambda row: first + positions[row], clocks)


def _why_not(cells: Sequence[str], indices: Sequence[int], width: int) -> str | None:
    """Return why a line is no row; None where it is one."""
    used = [cells[index] if index < len(cells) else "" for index in indices]
    if not all(map(is_like_number, used)):
        judged = cells if len(cells) <= max(indices) else used  # a title in a cell of its own
        known = all(cell.lower() in _MISSING or is_like_number(cell) for cell in judged)
        return _EMPTY if known else _NO_NUMBERS
    if 0 < width < len(cells) and all(not cell or is_like_number(cell) for cell in cells):
        return "rows with too many cells"  # a decimal comma may have split a number
    return None


def _end_of_table(lines: Sequence[str], form: RowForm, positions: Sequence[int]) -> int:
    """Return the line at which a summary below a table begins: a few rows after a text or a gap."""
    for position in range(max(len(lines) - 1 - _FOOTER, 0), len(lines) - 1):
        cells = cells_of(lines[position], form.separator)
        time = cells[form.indices[0]] if len(cells) > form.indices[0] else ""
        used = [cells[k] for k in form.indices if k < len(cells)]
        if any(used) and (time.lower() in _MISSING or is_like_number(time)):
            continue
        below = sum(p > position for p in positions)
        return position if 0 < below <= _SUMMED and len(positions) > 2 * _FOOTER else len(lines)
    return len(lines)
