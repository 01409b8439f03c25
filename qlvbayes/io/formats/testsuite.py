"""Read MTS TestSuite: four lines that name the test, then names and units in two rows."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, decoded
from qlvbayes.io.formats.texttable import are_units, tables_in_two_rows


class TestSuite(AbstractFormat):
    """Layout of TestSuite: names and units in two rows; compression is negative in both columns.

    Files begin with a byte order mark, and forces are often in kN.
    """

    __test__: ClassVar[bool] = False  # pytest must not collect it
    name: ClassVar[str] = "testsuite"
    machine: ClassVar[str] = "MTS TestSuite (data acquisition as CSV or text)"
    marks: ClassVar[str] = "lines 'Test Run:' and 'Date:', and a row of units without parentheses"
    reads: ClassVar[str] = "(Running) Time, (Axial) Displacement, (Axial) Force; run name and date"
    reference: ClassVar[str] = "MTS TestSuite, exported raw data"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for the lines that name the run, and for the row of units."""
        lines = Lines.from_bytes(decoded(head).encode())
        settings = _settings(lines)
        return Sight.from_marks(
            {
                "a line 'Test Run:'": "test run" in settings,
                "a line 'Date:'": "date" in settings,
                "a row of units below the names": _header(lines) is not None,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the tests of the file."""
        return tables_in_two_rows(path, _header, _title_and_date)


def _settings(lines: Lines) -> dict[str, str]:
    """Return test, run and date from the lines that state them."""
    settings = {}
    for text in lines.texts:
        plain = text.strip().strip('"')
        if match := re.match(r"(File Path|Test Run|Test|Date)(?: Name)?\s*:[\s\",;]*(.*)", plain):
            settings[match[1].lower()] = match[2].strip(' "')
    return settings


def _title_and_date(lines: Lines, _: int) -> tuple[str, str]:
    """Return the run and the date."""
    settings = _settings(lines)
    return settings.get("test run", ""), settings.get("date", "")


def _header(lines: Lines) -> int | None:
    """Return the row of names: the one above a row of units."""
    for number, cells in lines.cells():
        bare = [cell for cell in cells if cell]
        if number and len(bare) > 2 and are_units(bare) and not any("(" in c for c in bare):
            return number - 1
    return None
