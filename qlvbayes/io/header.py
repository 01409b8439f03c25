"""Find where a table of text begins, and what its columns are: by names and units, or as stated."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import (
    LABELS,
    NamedColumn,
    in_cells,
    in_two_rows,
    is_tidy_name,
    measured,
    plain_name,
)
from qlvbayes.io.table import are_numbers
from qlvbayes.io.text import COMMENT, Lines, cells_of, is_like_number, separator_of
from qlvbayes.io.units import QUANTITIES, unit_of
from qlvbayes.io.wording import joined

NAMES = 3  # of time, displacement and force
_BLANK = 2  # most empty rows between the names and their units
_QUANTITIES = ("time", "displacement", "force")
_CLOCK = r"(t|time|clock|timestamp|zeit)( .*)?|.* (t|time|clock|timestamp)"
_OF_LOAD = r"(.* )?(force|load|f|fz|cell|loadcell|stress|kraft)( .*)?"
_OF_WAY = (
    r"(.* )?(disp|displacement|d|position|pos|encoder|stage|platen|strain|extension|weg|x|z)( .*)?"
)


@dataclass(frozen=True)
class Header:
    """Where a table begins: the lines of its names and of its first row (from 0), its columns.

    ``line`` is ``first`` where there are no names. ``picked`` are the columns of time, displacement
    (strain) and force (stress) where they are known already, and ``clock`` is the force's own.
    """

    line: int
    first: int
    columns: Sequence[NamedColumn]
    picked: dict[str, NamedColumn] | None = None
    clock: NamedColumn | None = None


def find_header(lines: Lines, blanks: bool = False, *, tidy: bool = False) -> Header | None:
    """Return the first row that names time, displacement and force, with units or numbers below.

    The names of a tidy file count where ``tidy`` is true. Units are in the row of names, in that
    below or in that above. ``blanks`` is whether blanks separate the cells.
    """
    rows = [cells for _, cells in lines.cells()]
    named: Header | None = None  # as a sentence about the columns may, where names follow
    for number, names in enumerate(rows):
        if sum(bool(cell) and not is_like_number(cell) for cell in names) < NAMES:
            if named and len(names) >= NAMES and are_numbers(names, range(NAMES)):
                break
            continue
        if not tidy and any(name in LABELS if blanks else is_tidy_name(name) for name in names):
            continue
        in_row = in_cells(names)
        nearest = range(number + 1, min(number + 2 + _BLANK, len(rows)))
        below = next((k for k in nearest if any(rows[k])), None)
        by_quantity = measured(in_row).values()
        used = [column.index for column in by_quantity if column] or [0]
        numbers = below is not None and are_numbers(rows[below], used)
        if _have_units(in_row):
            found = _shifted(Header(number, number + 1, in_row), lines)
            if numbers or found.columns[0].index:
                return found
            named = named or found
            continue
        if below is None:
            continue
        if numbers:
            above = in_two_rows(names, rows[number - 1]) if number else []
            if above and are_units(rows[number - 1]) and _have_units(above):
                return Header(number, number + 1, above)
            if all(by_quantity):
                return _shifted(Header(number, number + 1, in_row), lines)
        units = cells_of(lines.texts[below], separator_of(lines.texts[number]))
        if _have_units(columns := in_two_rows(names, units)):
            return Header(number, below + 1, columns)
    return named


def any_header(lines: Lines, blanks: bool) -> Header | None:
    """Return the header as `find_header` does, where a table may have the names of a tidy file."""
    return find_header(lines, blanks, tidy=True)


def _have_units(columns: Sequence[NamedColumn]) -> bool:
    """Return whether time, displacement and force are among columns, each with a unit."""
    return all(named and named.unit for named in measured(columns).values())


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a row holds units, one of them of time and one of force or stress."""
    kinds = ("time", "force", "stress")
    there = {kind for kind in kinds for cell in cells if cell.strip() and unit_of(cell, kind)}
    return "time" in there and len(there) > 1


def _shifted(header: Header, lines: Lines) -> Header:
    """Return the header of rows that begin with their own name, which the names do not count."""
    separator = separator_of(lines.texts[header.line])
    rows = [cells_of(text, separator) for text in lines.texts[header.first :][:2] if text.strip()]
    labels = [row[0] for row in rows if len(row) == len(header.columns) + 1]
    counted = labels in (["1", "2"], ["0", "1"]) or not any(map(is_like_number, labels))
    if len(labels) < 2 or not counted or not all(map(is_like_number, rows[0][1:])):
        return header
    columns = [replace(column, index=column.index + 1) for column in header.columns]
    return replace(header, columns=columns)


def columns_in(lines: Lines) -> list[NamedColumn]:
    """Return the columns of the first table; empty where there is none, of two or more."""
    for number, cells in lines.cells():
        if len(cells) > 1 and are_numbers(cells, range(min(len(cells), NAMES))):
            named = _names_above(lines, number, len(cells))
            return _columns(named, len(cells)) if named or len(cells) >= NAMES else []
    return []


def _columns(named: Sequence[Sequence[str]], width: int) -> list[NamedColumn]:
    """Return columns by the rows of names and units above them, or else by their numbers."""
    if not named:
        return [NamedColumn(k, f"column {k + 1}", "") for k in range(width)]
    return in_two_rows(*named) if len(named) > 1 else in_cells(named[0])


def _names_above(lines: Lines, first: int, width: int) -> list[list[str]]:
    """Return the row of names, and that of units, directly above a first row of numbers."""
    separator = separator_of(lines.texts[first])
    above = [cells_of(text, separator) for text in lines.texts[max(first - 2, 0) : first]]
    rows = [row for row in above if width <= len(row) <= width + 1]
    rows = [row for row in rows if not any(map(is_like_number, row))]
    kinds = [kind for either in QUANTITIES for kind in either]
    units = any(unit_of(cell, kind) for row in rows[-1:] for cell in row for kind in kinds)
    return rows if units else rows[-1:]


# Columns that the user states


def named_columns(text: str) -> tuple[str, str, str]:
    """Return ``t,x,F`` as the columns of time, displacement (or strain) and force (or stress)."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != NAMES or len({*parts, ""}) != NAMES + 1:
        raise InputError(
            f"--columns {text[:200]!r} are not three different columns",
            remedy="write the names of time, displacement and force as t,x,F, or their numbers "
            "from 1 as 1,2,3",
        )
    return parts[0], parts[1], parts[2]


def stated_header(lines: Lines, stated: Sequence[str], file: Path) -> Header:
    """Return the header of the table that has the stated columns; an InputError says what lacks."""
    for first, cells in lines.cells():
        named = _names_above(lines, first, len(cells))
        columns = _columns(named, len(cells))
        written = named[0] if named else [""] * len(cells)
        indices = [k for name in stated for k in _stated(name, written, columns)]
        if len(indices) == NAMES and are_numbers(cells, indices):
            picked = {key: columns[k] for key, k in zip(_QUANTITIES, indices, strict=True)}
            return Header(first - len(named), first, columns, picked)
    widest = max((cells for _, cells in lines.cells()), key=len, default=[])
    shown = f" (the file has: {', '.join(widest)[:200]})" if len(widest) > 1 else ""
    raise InputError(
        f"the columns {joined(list(stated))} are not there{shown}",
        file=file,
        remedy="write them as the file does, or their numbers from 1, as --columns 1,2,3",
    )


def _stated(name: str, written: Sequence[str], columns: Sequence[NamedColumn]) -> list[int]:
    """Return the index of a stated column: by its name, with or without its unit, or number."""
    words = [
        (k, (cell, one.name)) for k, (cell, one) in enumerate(zip(written, columns, strict=False))
    ]
    exact = [k for k, own in words if name in own][:1]
    alike = exact or [k for k, own in words if plain_name(name) in map(plain_name, own)]
    if not alike and name.isdecimal() and 0 < int(name) <= len(columns):
        return [int(name) - 1]
    return alike if len(alike) == 1 else []


# Two clocks


def clocks_in(lines: Lines) -> tuple[int, list[NamedColumn], list[NamedColumn]]:
    """Return the first line that is no comment, the columns that it names, and their clocks."""
    for number, text in enumerate(lines.texts):
        if text.strip() and not COMMENT.match(text):
            columns = in_cells(cells_of(text, separator_of(text)))
            return number, columns, [c for c in columns if re.fullmatch(_CLOCK, plain_name(c.name))]
    return 0, [], []


def two_clock_header(lines: Lines, blanks: bool = False) -> Header | None:
    """Return a header with a clock for each channel, of which the names say which is whose."""
    number, columns, clocks = clocks_in(lines)
    by_quantity = measured([c for c in columns if c not in clocks])
    by_quantity.pop("time")
    if len(clocks) != 2 or not all(by_quantity.values()):
        return None
    named = [plain_name(clock.name) for clock in clocks]
    of_load = [bool(re.fullmatch(_OF_LOAD, name)) for name in named]
    of_way = [bool(re.fullmatch(_OF_WAY, name)) for name in named]
    if all(of_load) or all(of_way) or of_load == of_way:
        return None
    way, load = clocks if of_load[1] or of_way[0] else clocks[::-1]
    picked = {"time": way, **{key: one for key, one in by_quantity.items() if one}}
    return Header(number, number + 1, columns, picked, load)
