"""Read ZwickRoell testXpert as text: localised names, rows of the approach, uneven sampling."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import plain_name, quantities
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, cells_of, content, decoded, separator_of
from qlvbayes.io.formats.texttable import are_units, in_cells, in_two_rows, seconds_of, tables

OWN_WORDS = (
    "standardkraft", "standard force", "force standard", "fuerza estandar", "forza standard",
)  # fmt: skip
"""testXpert's names for the force, without accents."""


class TestXpert(AbstractFormat):
    """Layout of testXpert: pairs of key and value, then names with units below or in brackets."""

    __test__: ClassVar[bool] = False  # pytest must not collect it
    name: ClassVar[str] = "testxpert"
    machine: ClassVar[str] = "ZwickRoell, testXpert II and III (text: .txt, .tra, .csv)"
    marks: ClassVar[str] = (
        "testXpert's own names (Standardkraft, Standard force) in addition to a time"
    )
    reads: ClassVar[str] = "Prüfzeit or Test time, Standardweg or Standard travel, Standardkraft"
    reference: ClassVar[str] = "testXpert, export of curves"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for its name of the force in a row with a time, and for units."""
        lines = Lines.from_bytes(decoded(head).encode())
        header = names_row([cells for _, cells in lines.cells()])
        return Sight.from_marks(
            {
                "a row of names with Standardkraft or Standard force and a time": header >= 0,
                "units in brackets or in the row below": header >= 0
                and bool(_units(lines, header)),
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the tests of the file."""
        data = content(path)
        lines = Lines.from_bytes(data)
        header = names_row([cells for _, cells in lines.cells()])
        kind = _units(lines, header) if header >= 0 else ""
        if not kind:
            remedy = "export the curves again"
            raise InputError("no row of names with units", file=path, remedy=remedy)
        separator = separator_of(lines.texts[header])
        names = cells_of(lines.texts[header], separator)
        if header + 1 == len(lines.texts):
            remedy = "export the curves again"
            raise InputError("there are no rows below the names", file=path, remedy=remedy)
        below = cells_of(lines.texts[header + 1], separator)
        columns = in_cells(names) if kind == "same row" else in_two_rows(names, below)
        first = header + 1 + (kind == "next row")
        dates = [seconds_of(cell) for _, cells in lines.cells() for cell in cells if ":" in cell]
        began = next((date for date in dates if date is not None), None)
        return tables(columns, data, lines, path, header, first, began=began)


def names_row(rows: Sequence[Sequence[str]]) -> int:
    """Return the row that names columns in testXpert's words, or -1."""
    for number, cells in enumerate(rows):
        columns = in_cells(cells)
        own = any(plain_name(column.name) in OWN_WORDS for column in columns)
        if own and "time" in quantities(columns):
            return number
    return -1


def _units(lines: Lines, header: int) -> str:
    """Return the row of the units: the names' ``same row`` or the ``next row``; empty if none."""
    separator = separator_of(lines.texts[header])
    if all(column.unit for column in in_cells(cells_of(lines.texts[header], separator))):
        return "same row"
    below = lines.texts[header + 1] if header + 1 < len(lines.texts) else ""
    return "next row" if are_units(cells_of(below, separator)) else ""
