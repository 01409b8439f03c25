"""Read a laboratory's own file in which displacement and force have a clock each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import NamedColumn, plain_name, quantities, recording
from qlvbayes.io.formats.format import AbstractFormat, Channel, Recording, Sight
from qlvbayes.io.formats.textfile import Lines, cells_of, content, decoded, separator_of
from qlvbayes.io.formats.textrows import read_rows
from qlvbayes.io.formats.texttable import in_cells

_CLOCK = r"(t|time|clock|timestamp|zeit)( .*)?|.* (t|time|clock|timestamp)"
_OF_LOAD = r"(force|load|f|fz|cell|loadcell|stress|kraft)"
_OF_WAY = r"(disp|displacement|d|position|pos|encoder|stage|platen|strain|extension|weg|x|z)"


class TwoClocks(AbstractFormat):
    """Row of names such as ``t_disp_s,disp_mm,t_force_s,force_N``, then rows of numbers.

    One clock for both would delay the force by the difference between the two.
    """

    name: ClassVar[str] = "two-clocks"
    machine: ClassVar[str] = "a laboratory's own CSV with a clock for each channel"
    marks: ClassVar[str] = "two columns of time, one named after force or displacement; units"
    reads: ClassVar[str] = "displacement on its own clock, brought to the times of the force"
    reference: ClassVar[str] = "any logger that stamps its channels one by one"

    @staticmethod
    def sniff(head: bytes) -> Sight:
        """Look for two clocks that can be distinguished, and for the columns they belong to."""
        _, names = _header(Lines.from_bytes(decoded(head).encode()))
        columns = in_cells(names)
        clocks = _clocks(columns)
        by_quantity = quantities(_others(columns))
        return Sight.from_marks(
            {
                "two columns of time": len(clocks) == 2,
                "one of them named after force or displacement": _assigned(clocks) is not None,
                "a column of displacement": "displacement" in by_quantity
                or "strain" in by_quantity,
                "a column of force": "force" in by_quantity or "stress" in by_quantity,
            }
        )

    @staticmethod
    def read(path: Path) -> tuple[Recording, ...]:
        """Return the one test of the file."""
        data = content(path)
        lines = Lines.from_bytes(data)
        number, names = _header(lines)
        columns = in_cells(names)
        clocks = _assigned(_clocks(columns))
        by_quantity = quantities(_others(columns))
        way = by_quantity.get("displacement") or by_quantity.get("strain")
        load = by_quantity.get("force") or by_quantity.get("stress")
        if clocks is None or way is None or load is None:
            remedy = "name the clocks t_disp_s and t_force_s"
            raise InputError("the two clocks cannot be distinguished", file=path, remedy=remedy)
        kinds = {id(named): quantity for quantity, named in by_quantity.items()}
        picked = {"time": clocks[0], kinds[id(way)]: way, kinds[id(load)]: load}
        wanted = [*picked.values(), clocks[1]]
        separator = separator_of(lines.texts[number])
        rows = read_rows(
            data[lines.starts[number + 1] :], separator, [w.index for w in wanted], path, number + 2
        )
        *values, second = rows.columns
        read = recording(columns, picked, values, rows.dropped)
        own = Channel("time", second, clocks[1].unit, clocks[1].name)
        unused = tuple(name for name in read.unused if name != clocks[1].name)
        return (replace(read, load_time=own, unused=unused),)


def _header(lines: Lines) -> tuple[int, list[str]]:
    """Return the first line that is no comment, and its cells."""
    for number, text in enumerate(lines.texts):
        if text.strip() and not text.startswith(("#", "%")):
            return number, cells_of(text, separator_of(text))
    return 0, []


def _clocks(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
    return [column for column in columns if re.fullmatch(_CLOCK, plain_name(column.name))]


def _others(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
    clocks = {column.index for column in _clocks(columns)}
    return [column for column in columns if column.index not in clocks]


def _assigned(clocks: Sequence[NamedColumn]) -> tuple[NamedColumn, NamedColumn] | None:
    """Return the clocks of displacement and force; None where the names do not distinguish them."""
    if len(clocks) != 2:
        return None
    loads = [c for c in clocks if _has(c, _OF_LOAD)]
    ways = [c for c in clocks if _has(c, _OF_WAY)]
    if len(loads) > 1 or len(ways) > 1 or not (loads or ways) or loads == ways:
        return None
    load = loads[0] if loads else next(c for c in clocks if c is not ways[0])
    way = ways[0] if ways else next(c for c in clocks if c is not loads[0])
    return (way, load) if way is not load else None


def _has(clock: NamedColumn, words: str) -> bool:
    return any(re.fullmatch(words, word) for word in plain_name(clock.name).split())
