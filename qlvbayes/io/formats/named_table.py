"""Read any text table that names its columns with units, as those of rheometers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import NamedColumn, measured, plain_name
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textcells import are_numbers, is_like_number
from qlvbayes.io.formats.textfile import (
    Lines,
    cells_of,
    content,
    decoded,
    sections,
    separator_of,
    with_tabs,
)
from qlvbayes.io.formats.texttable import (
    adjacent_tests,
    by_specimen,
    in_cells,
    in_two_rows,
    refuse_other_header,
)
from qlvbayes.io.reading.header import LABELS, is_tidy_name

_NAMES = 3  # of time, displacement and force
_BLANK = 2  # most empty rows between the names and their units
_SHEAR = re.compile(r"\b(shear|scher\w*|schub\w*|cisaillement|taglio|cizalla\w*|corte)\b")


class NamedTable(AbstractFormat):
    """Table with names in one of five languages, units after or below them, then numbers.

    A name that is not known is that of the only column with such a unit. Where known names have no
    units at all, the user is asked for them.
    Cells of text among the numbers (a status) are ignored; where the names are repeated, a new test
    begins. Shear has no side that presses: its signs are kept.
    """

    name: ClassVar[str] = "table"
    machine: ClassVar[str] = "a table of named columns with units (rheometers, most programs)"
    marks: ClassVar[str] = "names of time, displacement or strain, force or stress, with units"
    reads: ClassVar[str] = "the three columns, units in brackets or in the row below, UTF-16 too"
    reference: ClassVar[str] = "Anton Paar RheoCompass, export of tables; ISO 6721-10 for the names"
    general: ClassVar[bool] = True

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for a row of names that are not those of a tidy file, and for units or numbers."""
        data, blanks = with_tabs(decoded(head).encode())
        lines = Lines.from_bytes(data)
        whole = _header(lines, blanks=blanks) is not None
        named = whole or any(
            all(measured(in_cells(cells)).values())
            for _, cells in lines.cells()
            if _may_name(cells)
        )
        return Sight.from_marks(
            {
                "a row that names time, displacement or strain, and force or stress": named,
                "their units or numbers below them, and no name of a tidy file": whole,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each time that the names appear, and for each specimen below them."""
        data, blanks = with_tabs(content(path))
        lines = Lines.from_bytes(data)
        if (header := _header(lines, blanks=blanks)) is None:
            raise InputError("no row of names with units", file=path, remedy="export it again")
        number, first, columns = header
        separator = separator_of(lines.texts[number])
        above = cells_of(lines.texts[number - 1], separator) if number else []
        parts = sections(data[lines.starts[first] :], lines.texts[number], first)
        tests = []
        for k, (start, part) in enumerate(parts, 1):
            refuse_other_header(part, columns, separator, path, start)
            of_part = str(k) if len(parts) > 1 else ""
            used, specimens = by_specimen(columns, part, separator, start)
            for specimen, line, rows in specimens:
                name = f"{of_part} {specimen}".strip()
                tests += adjacent_tests(
                    used, rows, separator, path, number, line, name=name, above=above
                )
        return tuple(replace(test, pressing=_is_sheared(test)) for test in tests)


def _is_sheared(test: Recording) -> bool:
    return any(_SHEAR.search(plain_name(channel.name)) for channel in (test.way, test.load))


def _may_name(cells: Sequence[str]) -> bool:
    """Return whether three cells are neither empty nor numbers, as names are."""
    return sum(bool(cell) and not is_like_number(cell) for cell in cells) >= _NAMES


def _header(lines: Lines, *, blanks: bool) -> tuple[int, int, list[NamedColumn]] | None:
    """Return the line of the names, the first line below names and units, and the columns."""
    rows = list(lines.cells())
    for number, names in rows:
        if not _may_name(names):
            continue
        if any(name in LABELS if blanks else is_tidy_name(name) for name in names):
            continue
        in_row = in_cells(names)
        by_quantity = measured(in_row).values()
        if all(named and named.unit for named in by_quantity):
            return number, number + 1, in_row
        below = next((k for k, cells in rows[number + 1 :][: _BLANK + 1] if any(cells)), None)
        if below is None:
            continue
        picked = [named.index for named in by_quantity if named]
        if all(by_quantity) and are_numbers(rows[below][1], picked):
            return number, number + 1, in_row
        columns = in_two_rows(
            names, cells_of(lines.texts[below], separator_of(lines.texts[number]))
        )
        if all(named and named.unit for named in measured(columns).values()):
            return number, below + 1, columns
    return None
