"""Read Instron's Bluehill Universal: a table of results, then ``Raw Data``."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import quantities
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, cells_of, content, decoded, separator_of
from qlvbayes.io.formats.texttable import in_cells, tables

_TITLES = ("raw data", "rohdaten", "donnees brutes", "données brutes", "datos sin procesar")


class BluehillUniversal(AbstractFormat):
    """Results, a line ``Raw Data``, names with units in parentheses, then rows of numbers.

    The text may also be UTF-16.
    """

    name: ClassVar[str] = "bluehill-universal"
    machine: ClassVar[str] = "Instron, Bluehill Universal (results and raw data as CSV)"
    marks: ClassVar[str] = "a line 'Raw Data' and below it names with units in parentheses"
    reads: ClassVar[str] = "Time (s), Displacement (mm), Force (N) below 'Raw Data'"
    reference: ClassVar[str] = "Bluehill Universal, exported raw data"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for a line that begins the raw data, and for names with units."""
        lines = Lines.from_bytes(decoded(head).encode())
        title = _title(lines)
        named = title is not None and _names(lines, title) is not None
        return Sight.from_marks(
            {
                "a line 'Raw Data'": title is not None,
                "names with units in parentheses below it": named,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the tests of the file."""
        data = content(path)
        lines = Lines.from_bytes(data)
        title = _title(lines)
        header = None if title is None else _names(lines, title)
        if header is None:
            raise InputError("no names below 'Raw Data'", file=path, remedy="export it again")
        separator = separator_of(lines.texts[header])
        columns = in_cells(cells_of(lines.texts[header], separator))
        return tables(columns, data, lines, path, header, header + 1)


def _title(lines: Lines) -> int | None:
    for number, cells in lines.cells():
        if cells and cells[0].lower().startswith(_TITLES) and not any(cells[1:]):
            return number
    return None


def _names(lines: Lines, title: int) -> int | None:
    """Return the first row below the title, where it names columns with units."""
    for number, cells in lines.cells():
        if number > title and any(cells):
            by_quantity = quantities(in_cells(cells))
            fitting = (
                "time" in by_quantity and bool(by_quantity["time"].unit) and len(by_quantity) > 2
            )
            return number if fitting else None
    return None
