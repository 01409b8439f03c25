"""Read a text table of which the user states the columns of time, displacement and force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import NamedColumn, plain_name
from qlvbayes.io.formats.format import AbstractFormat, Recording, Sight
from qlvbayes.io.formats.textcells import are_numbers, is_like_number
from qlvbayes.io.formats.textfile import (
    Lines,
    cells_of,
    content,
    decoded,
    refuse_cells,
    sections,
    separator_of,
    with_tabs,
)
from qlvbayes.io.formats.texttable import in_cells, in_two_rows, recorded, refuse_other_header
from qlvbayes.io.wording import joined

_QUANTITIES = ("time", "displacement", "force")
_NONE = "\0"  # no line of a file is equal to it
_SHOWN = 200  # characters of the file's own names that an error shows


def named_columns(text: str) -> tuple[str, str, str]:
    """Return ``t,x,F`` as the columns of time, displacement (or strain) and force (or stress)."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != len(_QUANTITIES) or len({*parts, ""}) != len(parts) + 1:
        raise InputError(
            f"--columns {text[:_SHOWN]!r} are not three different columns",
            remedy="write the names of time, displacement and force as t,x,F, or their numbers "
            "from 1 as 1,2,3",
        )
    return parts[0], parts[1], parts[2]


def stated_columns(stated: Sequence[str]) -> type[AbstractFormat]:
    """Return the layout of a text table with these columns of time, displacement and force."""

    class StatedColumns(AbstractFormat):
        """Table with or without a row of names, its cells separated by any one mark or blanks."""

        name: ClassVar[str] = "columns"
        machine: ClassVar[str] = f"a table with the columns {joined(list(stated))}, as stated"
        marks: ClassVar[str] = "three columns, which --columns states"
        reads: ClassVar[str] = "these columns; units after the names, below them, or by --units"
        reference: ClassVar[str] = "none: the user knows the file"

        @staticmethod
        def sniff(head: bytes) -> Sight:
            """Take every file that has a text for such a table."""
            return Sight.from_marks({StatedColumns.marks: bool(head)})

        @staticmethod
        def read(path: Path) -> tuple[Recording, ...]:
            """Return one test for each time that the names appear."""
            data, _ = with_tabs(content(path))
            return _Table.from_data(data, stated, path).recordings(data, path)

    return StatedColumns


@dataclass(frozen=True)
class _Table:
    """Columns of a text, the separator of its cells, and the line of the first row (from 0).

    ``names`` is the line of names, where a further test begins; ``_NONE`` where there is none.
    """

    columns: Sequence[NamedColumn]
    picked: dict[str, NamedColumn]
    separator: str
    names: str
    first: int
    start: int

    @classmethod
    def from_data(cls, data: bytes, stated: Sequence[str], file: Path) -> _Table:
        """Return the table in which the stated columns are; an InputError says what lacks."""
        lines = Lines.from_bytes(data)
        numbered = all(name.isdecimal() for name in stated)
        table = _by_number(lines, stated) if numbered else _by_name(lines, stated)
        if table is None:
            raise _without(lines, stated, file)
        return table

    def recordings(self, data: bytes, file: Path) -> tuple[Recording, ...]:
        """Return one test for each time that the names appear."""
        parts = sections(data[self.start :], self.names, self.first)
        for line, rows in parts:
            refuse_other_header(rows, self.columns, self.separator, file, line)
        return tuple(
            recorded(
                self.columns, self.picked, rows, self.separator, file, line,
                str(k) if len(parts) > 1 else "",
            )
            for k, (line, rows) in enumerate(parts, 1)
        )  # fmt: skip


def _by_name(lines: Lines, stated: Sequence[str]) -> _Table | None:
    """Return the table below the first line that has the stated names; None without one."""
    for number, names in lines.cells():
        columns = in_cells(names)
        found = [_named(name, names, columns) for name in stated]
        if None in found:
            continue
        indices = [column.index for column in found if column is not None]
        separator = separator_of(lines.texts[number])
        below = number + 1
        while below < len(lines.texts) and not lines.texts[below].strip():
            below += 1
        units = cells_of(lines.texts[below], separator) if below < len(lines.texts) else []
        first = number + 1
        if units and not are_numbers(units, indices):
            columns, first = in_two_rows(names, units), below + 1
        return _table(lines, columns, indices, separator, number, first)
    return None


def _by_number(lines: Lines, stated: Sequence[str]) -> _Table | None:
    """Return the table from the first line with numbers in the stated columns; None without one."""
    indices = [int(number) - 1 for number in stated]
    for first, cells in lines.cells():
        if min(indices) < 0 or not are_numbers(cells, indices):
            continue
        separator = separator_of(lines.texts[first])
        named = _names_above(lines, first, len(cells), indices)
        if not named:
            columns = [NamedColumn(k, f"column {k + 1}", "") for k in range(len(cells))]
            return _table(lines, columns, indices, separator, first, first)
        columns = in_two_rows(*named) if len(named) > 1 else in_cells(named[0])
        return _table(lines, columns, indices, separator, first - len(named), first)
    return None


def _names_above(lines: Lines, first: int, width: int, indices: Sequence[int]) -> list[list[str]]:
    """Return the row of names, and that of units, directly above a first row of numbers."""
    separator = separator_of(lines.texts[first])
    above = [cells_of(text, separator) for text in lines.texts[max(first - 2, 0) : first]]
    wide = [row for row in above if len(row) == width]
    return [row for row in wide if not any(is_like_number(row[index]) for index in indices)]


def _table(
    lines: Lines,
    columns: Sequence[NamedColumn],
    indices: Sequence[int],
    separator: str,
    number: int,
    first: int,
) -> _Table:
    """Return the table with the names at a line and the rows from another one on."""
    picked = {key: columns[index] for key, index in zip(_QUANTITIES, indices, strict=True)}
    names = lines.texts[number] if number < first else _NONE
    return _Table(columns, picked, separator, names, first, lines.starts[first])


def _named(name: str, cells: Sequence[str], columns: Sequence[NamedColumn]) -> NamedColumn | None:
    """Return the column that is called so, as a whole, without its unit, or in other capitals."""
    for column, cell in zip(columns, cells, strict=True):
        if name in (cell, column.name):
            return column
    plain = plain_name(name)
    alike = [
        column
        for column, cell in zip(columns, cells, strict=True)
        if plain and plain in (plain_name(cell), plain_name(column.name))
    ]
    return alike[0] if len(alike) == 1 else None


def columns_in(head: bytes) -> list[str]:
    """Return the names, or else the numbers, of a table's columns; empty where there is none."""
    lines = Lines.from_bytes(with_tabs(decoded(head).encode())[0])
    for number, cells in lines.cells():
        if len(cells) < len(_QUANTITIES) or not are_numbers(cells, range(len(_QUANTITIES))):
            continue
        named = _names_above(lines, number, len(cells), range(len(_QUANTITIES)))
        names = named[0] if named else []
        shown = [name or str(k + 1) for k, name in enumerate(names)]
        return shown or [str(k + 1) for k in range(len(cells))]
    return []


def _without(lines: Lines, stated: Sequence[str], file: Path) -> InputError:
    """Return the error of a file that lacks the stated columns, with the names that it has."""
    if all(name.isdecimal() and int(name) for name in stated):
        refuse_cells(lines, [int(number) - 1 for number in stated], file)
    widest = max((cells for _, cells in lines.cells()), key=len, default=[])
    shown = f" (the file has: {', '.join(widest)[:_SHOWN]})" if len(widest) > 1 else ""
    return InputError(
        f"the columns {joined(list(stated))} are not there{shown}",
        file=file,
        remedy="write them as the file does, or their numbers from 1, as --columns 1,2,3",
    )
