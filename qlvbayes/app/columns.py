"""Read a table with an unknown header: the user states each column's quantity and unit."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.machineunits import unit_of
from qlvbayes.io.reading.csvtext import blocks, head
from qlvbayes.io.reading.dialect import split_row
from qlvbayes.io.units import SUFFIXES, column_name

_SHOWN = 8  # rows that are shown
_DRAWN = 300  # points of the curves
_LOOKED_AT = 60  # lines within which the table must begin
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?")
_NAMES = {
    "time": r"time|zeit|^t$|\bt\b",
    "displacement": r"disp|pos|ext|depth|travel|stroke|crosshead|indent|weg|^d$|^x$|strain",
    "force": r"force|load|kraft|^f$|stress",
}
_UNITS = {
    "time": tuple(SUFFIXES["time"]),
    "displacement": (*SUFFIXES["displacement"], "strain"),
    "force": (*SUFFIXES["force"], *SUFFIXES["stress"]),
}
_WORDS = {"time": "time", "displacement": "displacement (or strain)", "force": "force (or stress)"}


def is_table(file: Path) -> bool:
    """Return whether a file is a text with names above columns of numbers."""
    try:
        _Table.from_file(file)
    except InputError:
        return False
    return True


def asked(file: Path) -> dict[str, Any]:
    """Return the questions about a table; an InputError is raised where the file has no table."""
    table = _Table.from_file(file)
    guesses = {what: table.guess(what) for what in _NAMES}
    ask: list[dict[str, Any]] = [
        {"name": what, "text": f"the column of {_WORDS[what]}", "choices": list(table.header),
         "value": guesses[what], "optional": False}
        for what in _NAMES
    ]  # fmt: skip
    ask += [
        {"name": name, "text": f"the column of the {name}'s name, if there is one",
         "choices": list(table.header), "value": name if name in table.header else None,
         "optional": True}
        for name in ("pad", "test")
    ]  # fmt: skip
    ask += [
        {"name": f"{what}_unit", "text": f"the unit of {_WORDS[what]}", "choices": list(units),
         "value": _unit_in(guesses[what], what), "optional": False}
        for what, units in _UNITS.items()
    ]  # fmt: skip
    rows = [list(table.header), *table.rows[:_SHOWN]]
    text = str(
        InputError(
            f"the columns {', '.join(table.header)[:200]} are not known",
            file=file.name,
            line=table.line,
            remedy="say which is what",
        )
    )
    questions = {"file": file.name, "kind": "columns", "rows": rows, "ask": ask, "text": text}
    return questions | {"curves": table.curves(guesses)}


def renamed(file: Path, answers: dict[str, str]) -> bytes:
    """Return the file with a tidy file's column names, and with all lines at their numbers."""
    table = _Table.from_file(file)
    names: dict[str, str] = {}
    for what in _NAMES:
        column, unit = answers.get(what), answers.get(f"{what}_unit")
        if column not in table.header:
            raise InputError(
                f"no column is chosen as the {what}", file=file, remedy="choose one of the columns"
            )
        if unit not in _UNITS[what]:
            raise InputError(
                f"the unit of {what} is not stated",
                file=file,
                remedy=f"use {', '.join(_UNITS[what])}",
            )
        if column in names:
            raise InputError(
                f"the column {column!r} is chosen as two quantities",
                file=file,
                remedy="choose another for one of them",
            )
        names[column] = _tidy(what, unit)
    for what in ("pad", "test"):
        if (column := answers.get(what)) in table.header and column not in names:
            names[str(column)] = what
    cells = [names.get(name, f"({name})") for name in table.header]
    out = io.StringIO()
    csv.writer(out, delimiter=table.separator, lineterminator="\n").writerow(cells)
    lines = b"".join(blocks(file)).decode().split("\n")
    above = [f"# {line}" for line in lines[: table.line - 1]]
    header = out.getvalue().rstrip("\n")
    return "\n".join([*above, header, *lines[table.line :]]).encode()


def _tidy(what: str, unit: str) -> str:
    if unit == "strain":
        return "strain"
    if what == "force" and unit in SUFFIXES["stress"]:
        return column_name("stress", unit)
    return column_name(what, unit)


def _unit_in(column: str | None, what: str) -> str | None:
    """Return the unit in a column's name, as '(mm)' or after an underscore."""
    words = re.findall(r"[\w/%µμ]+", (column or "").replace("_", " "))
    for word in reversed(words):
        for quantity in {"displacement": ("displacement",), "force": ("force", "stress")}.get(
            what, (what,)
        ):
            unit = unit_of(word, quantity)
            if unit is not None and unit.factor == 1.0 and unit.tidy in _UNITS[what]:
                return unit.tidy
    return None


class _Table:
    """Header and first rows of a text file; ``line`` is the header's line number, from 1."""

    def __init__(
        self, header: Sequence[str], rows: list[list[str]], separator: str, line: int
    ) -> None:
        self.header = tuple(header)
        self.rows = rows
        self.separator = separator
        self.line = line

    @classmethod
    def from_file(cls, file: Path) -> _Table:
        """Return the table below the first line that has rows of three or more numbers below."""
        lines = head(file).decode("utf-8").split("\n")
        for separator in (",", ";", "\t"):
            cells = [split_row(line, separator) if line.strip() else [] for line in lines]
            for k, row in enumerate(cells[:_LOOKED_AT]):
                below = [one for one in cells[k + 1 : k + 4] if one]
                counts = [sum(_is_number(x) for x in one) for one in below]
                wide = len(row) >= len(_NAMES) and len(set(row)) == len(row)
                if wide and counts and min(counts) >= len(_NAMES) and not any(map(_is_number, row)):
                    rows = [one for one in cells[k + 1 :] if len(one) == len(row)]
                    return cls(row, rows, separator, k + 1)
        raise InputError(
            "no header above three columns of numbers was found",
            file=file,
            remedy="export CSV with time_s, displacement_mm, force_N",
        )

    def guess(self, what: str) -> str | None:
        """Return the column that is named like a quantity."""
        named = [name for name in self.header if re.search(_NAMES[what], name, re.IGNORECASE)]
        return named[0] if named else None

    def curves(self, columns: dict[str, str | None]) -> dict[str, list[float]] | None:
        """Return the guessed columns, thinned; None where one is missing."""
        if None in columns.values():
            return None
        some = self.rows[:: max(1, len(self.rows) // _DRAWN)]
        indices = {what: self.header.index(str(name)) for what, name in columns.items()}
        whole = [row for row in some if all(_is_number(row[k]) for k in indices.values())]
        return {
            what: [float(row[k].replace(",", ".")) for row in whole] for what, k in indices.items()
        }


def _is_number(text: str) -> bool:
    return _NUMBER.fullmatch(text) is not None
