"""Read CellScale UniVert and MicroTester: sets and cycles in columns, units after names."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from qlvbayes.io.formats.columns import plain_name, quantities
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, cells_of, content, decoded, separator_of
from qlvbayes.io.formats.texttable import in_cells, table


class CellScale(AbstractFormat):
    """Columns ``SetName, Cycle, Time_S, Size_mm, Displacement_mm, Force_N`` of CellScale.

    With a tip the units are um and uN. Sets and cycles follow one another on one clock: they are
    one test.
    """

    name: ClassVar[str] = "cellscale"
    machine: ClassVar[str] = "CellScale UniVert, MicroTester (data as CSV)"
    marks: ClassVar[str] = "columns SetName and Cycle in addition to Time_S"
    reads: ClassVar[str] = "Time_S, Displacement_mm or Tip_um, Force_N or Force_uN"
    reference: ClassVar[str] = "CellScale UniVert user manual, output columns"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for its columns in the first row."""
        names = _names(Lines.from_bytes(decoded(head).encode()))
        plain_names = [plain_name(name) for name in names]
        by_quantity = quantities(in_cells(names))
        return Sight.from_marks(
            {
                "a column SetName": any(
                    name in ("setname", "set name", "set") for name in plain_names
                ),
                "a column Cycle": "cycle" in plain_names,
                "a column Time_S": "time" in by_quantity
                and by_quantity["time"].unit.lower() == "s",
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the one test of the file."""
        data = content(path)
        lines = Lines.from_bytes(data)
        separator = separator_of(lines.texts[0])
        columns = in_cells(_names(lines))
        measured = [c for c in columns if plain_name(c.name) not in _LABELS]
        new_index = {c.index: k for k, c in enumerate(measured)}
        rows = _without_labels(data[lines.starts[1] :], separator, len(columns) - len(measured))
        own = [type(c)(new_index[c.index], c.name, c.unit) for c in measured]
        return (table(own, rows, separator, path, 0, 1),)


_LABELS = ("setname", "set name", "set", "cycle")


def _names(lines: Lines) -> list[str]:
    return cells_of(lines.texts[0], separator_of(lines.texts[0]))


def _without_labels(rows: bytes, separator: str, count: int) -> bytes:
    """Return rows without their first cells, which hold text such as '1-Compress'."""
    mark = separator.encode()
    return b"\n".join(line.split(mark, count)[-1] for line in rows.split(b"\n"))
