"""Read Instron's Bluehill 3: names of the columns in one row, units in parentheses below."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.formats.columns import quantities
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, decoded
from qlvbayes.io.formats.texttable import in_two_rows, tables_in_two_rows


class BluehillThree(AbstractFormat):
    """Layout of Bluehill 2 and 3: optional pairs of key and value, a blank line, then the table.

    Numbers may be quoted, with a decimal comma within commas or with commas at thousands.
    """

    name: ClassVar[str] = "bluehill-3"
    machine: ClassVar[str] = "Instron, Bluehill 2 and 3 (raw data as CSV)"
    marks: ClassVar[str] = "a row of names with time, and a row of units, each in parentheses"
    reads: ClassVar[str] = "Time, (Compressive) Extension, (Compressive) Load; start time, label"
    reference: ClassVar[str] = "Bluehill 3 reference manual, exported raw data"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for a row of names above a row of units in parentheses."""
        lines = Lines.from_bytes(decoded(head).encode())
        named = any(_is_names(cells) for _, cells in lines.cells())
        return Sight.from_marks(
            {
                "a row of names with time and load": named,
                "units in parentheses in the row below": _header(lines) is not None,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the tests of the file."""
        return tables_in_two_rows(path, _header, _title_and_date)


def _is_names(cells: list[str]) -> bool:
    by_quantity = quantities(in_two_rows(cells, []))
    return "time" in by_quantity and ("force" in by_quantity or "stress" in by_quantity)


def _header(lines: Lines) -> int | None:
    rows = list(lines.cells())
    for (number, names), (_, units) in itertools.pairwise(rows):
        written = [unit for unit in units if unit]
        bracketed = [bool(re.fullmatch(r"\([^()]*\)", unit)) for unit in written]
        if len(written) >= 3 and all(bracketed) and _is_names(names):
            return number
    return None


def _title_and_date(lines: Lines, header: int) -> tuple[str, str]:
    """Return the specimen and the date from the pairs of key and value above the table."""
    pairs = [cells for number, cells in lines.cells() if number < header and len(cells) > 1]
    settings = {key.lower().removesuffix(":").strip(): value for key, value, *_ in pairs}
    return settings.get("specimen label", ""), settings.get("general : start time", "")
