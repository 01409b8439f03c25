"""Read Optics11 Chiaro and Piuma: a header of settings, then time, load and indentation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.formats.columns import quantities
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, cells_of, decoded, with_header
from qlvbayes.io.formats.texttable import in_cells, seconds_of, table


class Chiaro(AbstractFormat):
    """Columns ``Time (s), Load (uN), Indentation (nm), Cantilever (nm), Piezo (nm)``.

    Tabs separate them. The depth is the indentation, from which the bending of the cantilever is
    subtracted.
    """

    name: ClassVar[str] = "chiaro"
    machine: ClassVar[str] = "Optics11 Chiaro, Piuma (text)"
    marks: ClassVar[str] = "a line 'k (N/m)', and names with Load (uN) and Indentation (nm)"
    reads: ClassVar[str] = "Time (s), Indentation (nm), Load (uN); date"
    reference: ClassVar[str] = "Optics11 Life, Piuma and Chiaro user manual, data files"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for the cantilever's stiffness, and for the names."""
        lines = Lines.from_bytes(decoded(head).encode())
        return Sight.from_marks(
            {
                "a line 'k (N/m)'": any(text.startswith("k (N/m)") for text in lines.texts),
                "names with Load and Indentation": _header(lines) is not None,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the one indentation of the file."""
        data, lines, header = with_header(path, _header, "no row of names", "export the file again")
        columns = in_cells(cells_of(lines.texts[header], "\t"))
        first = cells_of(lines.texts[0], "\t")
        settings = dict(zip(first[::2], first[1::2], strict=False))
        began = seconds_of(f"{settings.get('Date', '')} {settings.get('Time', '')}")
        rows = data[lines.starts[header + 1] :]
        recorded = table(columns, rows, "\t", path, header, header + 1, began=began)
        return (
            replace(recorded, pressing=True),
        )  # a tip is pressed in, and may stick: the sign is known


def _header(lines: Lines) -> int | None:
    for number, text in enumerate(lines.texts):
        if "\tIndentation (" in text and "time" in quantities(in_cells(cells_of(text, "\t"))):
            return number
    return None
