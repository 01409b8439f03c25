"""Read Bose (now TA) WinTest: a name ended by a NUL, and a header before every scan."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, cells_of, content, decoded, sections, separator_of
from qlvbayes.io.formats.texttable import in_two_rows, table


class WinTest(AbstractFormat):
    """Scans, each after names ``"Points","Elapsed Time","Disp","Load",`` and a row of units.

    Every scan is a test; one of fewer than ten rows is a header left over, and dropped.
    """

    name: ClassVar[str] = "wintest"
    machine: ClassVar[str] = "Bose or TA ElectroForce, WinTest (text)"
    marks: ClassVar[str] = "names with 'Elapsed Time', and units with 'Sec' in the row below"
    reads: ClassVar[str] = "Elapsed Time, Disp, Load of every scan (a test each)"
    reference: ClassVar[str] = "WinTest, exported data acquisition"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for the names, and for WinTest's own unit of time below them."""
        lines = Lines.from_bytes(decoded(head).encode())
        headers = _headers(lines)
        return Sight.from_marks(
            {
                "names with 'Elapsed Time'": bool(headers),
                "'Sec' in the row below": any(_units(lines, number) for number in headers),
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return one test for each scan."""
        data = content(path)
        lines = Lines.from_bytes(data)
        header = next((number for number in _headers(lines) if _units(lines, number)), None)
        if header is None:
            raise InputError("no names and units", file=path, remedy="export the file again")
        text = lines.texts[header]
        separator = separator_of(text)
        columns = in_two_rows(cells_of(text, separator), _units(lines, header))
        scans = sections(data[lines.starts[header + 1] :], text, header + 1)
        filled = [(first, scan) for first, scan in scans if scan.count(b"\n") > _LEAST]
        several = len(filled) > 1
        return tuple(
            table(
                columns, scan.partition(b"\n")[2], separator, path, header, first + 1,
                name=f"scan {number}" if several else "",
            )
            for number, (first, scan) in enumerate(filled, 1)
        )  # fmt: skip


_LEAST = 10  # lines that a test has at least


def _headers(lines: Lines) -> list[int]:
    return [n for n, cells in lines.cells() if "Elapsed Time" in cells[:2] and len(cells) > 2]


def _units(lines: Lines, header: int) -> list[str]:
    """Return the row of units below the names; empty where there is none."""
    below = lines.texts[header + 1] if header + 1 < len(lines.texts) else ""
    cells = cells_of(below, separator_of(lines.texts[header]))
    return cells if "Sec" in cells else []
