"""Read any text table that names its columns with units, as those of rheometers."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.formats.columns import NamedColumn, measured, plain_name
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import (
    Lines,
    cells_of,
    decoded,
    sections,
    separator_of,
    with_header,
)
from qlvbayes.io.formats.texttable import adjacent_tests, in_cells, in_two_rows

_BLANK = 2  # most empty rows between the names and their units
_BRACKETED = re.compile(r".*[(\[][^()\[\]]+[)\]]\s*")
_SHEAR = re.compile(r"\b(shear|scher\w*|schub\w*|cisaillement|taglio|cizalla\w*|corte)\b")


class NamedTable(AbstractFormat):
    """Table with names in one of five languages, units after or below them, then numbers.

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
        """Look for a row of names, and for their units."""
        lines = Lines.from_bytes(decoded(head).encode())
        named = any(all(measured(in_cells(cells)).values()) for _, cells in lines.cells())
        return Sight.from_marks(
            {
                "a row that names time, displacement or strain, and force or stress": named,
                "their units in brackets or in the row below": _header(lines) is not None,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each time that the names appear."""
        data, lines, (number, first, columns) = with_header(
            path, _header, "no row of names with units", "export it again"
        )
        separator = separator_of(lines.texts[number])
        above = cells_of(lines.texts[number - 1], separator) if number else []
        parts = sections(data[lines.starts[first] :], lines.texts[number], first)
        tests = []
        for k, (start, part) in enumerate(parts, 1):
            name = str(k) if len(parts) > 1 else ""
            tests += adjacent_tests(
                columns, part, separator, path, number, start, name=name, above=above
            )
        return tuple(replace(test, pressing=_is_sheared(test)) for test in tests)


def _is_sheared(test: Recording) -> bool:
    return any(_SHEAR.search(plain_name(channel.name)) for channel in (test.way, test.load))


def _header(lines: Lines) -> tuple[int, int, list[NamedColumn]] | None:
    """Return the line of the names, the first line below names and units, and the columns."""
    rows = list(lines.cells())
    for number, names in rows:
        by_quantity = measured(in_cells(names)).values()
        if not all(by_quantity):
            continue
        if all(_BRACKETED.fullmatch(names[named.index]) for named in by_quantity if named):
            return number, number + 1, in_cells(names)
        below = next((k for k, cells in rows[number + 1 :][: _BLANK + 1] if any(cells)), None)
        if below is None:
            continue
        columns = in_two_rows(
            names, cells_of(lines.texts[below], separator_of(lines.texts[number]))
        )
        if all(named and named.unit for named in measured(columns).values()):
            return number, below + 1, columns
    return None
