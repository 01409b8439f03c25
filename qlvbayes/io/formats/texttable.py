"""Make a recording of a table in a text file: names, units and rows of numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import (
    NamedColumn,
    chosen,
    columns_of,
    measured,
    on_clock,
    plain_name,
    recording,
    sheared_instead,
    side_by_side,
    split_header,
    that_moved,
    titles_of,
)
from qlvbayes.io.formats.format import Recording
from qlvbayes.io.formats.machineunits import unit_of
from qlvbayes.io.formats.textcells import is_like_number
from qlvbayes.io.formats.textfile import Lines, cells_of, sections, separator_of, with_header
from qlvbayes.io.formats.textrows import read_rows, refuse_split_numbers

_COPY = re.compile(r"\.\d+$")
_LEAST = 10  # lines that a test has at least below repeated names
_LETTERS = re.compile(rb"(?m)^[\"'(\[# ]*[^\d\s.,;+\-][^\n]*$")  # lines that begin with a letter
_SHOWN = 60  # characters of a line that an error shows
_MOST_TESTS = 200  # of one file: a column that changes more often is a counter
_SPECIMEN = re.compile(
    r"(specimen|sample|probe|prufling|eprouvette|echantillon|probeta|muestra|provino|campione|pad"
    r"|test|trial|run|versuch|essai|prova|ensayo)( ?(id|name|label|number|no|nr|nummer|numero))?"
)
_PARTS = ("time", "way", "load")
_DATES = (
    "%A, %B %d, %Y %H:%M:%S", "%a, %B %d, %Y %H:%M:%S", "%A, %B %d, %Y %I:%M:%S %p",
    "%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%S", "%d/%m/%Y %H:%M:%S", "%d.%m.%Y %H:%M:%S",
    "%m/%d/%Y %I:%M:%S %p",
)  # fmt: skip


def in_cells(cells: Sequence[str]) -> list[NamedColumn]:
    """Return columns whose units follow their names, in one row."""
    names = [_COPY.sub("", cell) for cell in cells]
    plain = [name if name in cells else cell for name, cell in zip(names, cells, strict=True)]
    return [NamedColumn(index, *split_header(cell)) for index, cell in enumerate(plain)]


def in_two_rows(names: Sequence[str], units: Sequence[str]) -> list[NamedColumn]:
    """Return columns whose units are in the row below their names."""
    padded = [*units, *[""] * len(names)]
    return [
        NamedColumn(index, name, padded[index].strip(" ()[]'\"").removeprefix("in "))
        for index, name in enumerate(names)
    ]


def tables_in_two_rows(
    path: Path,
    find: Callable[[Lines], int | None],
    find_title: Callable[[Lines, int], tuple[str, str]],
) -> tuple[Recording, ...]:
    """Return the tests below a row of names and a row of units."""
    data, lines, first = with_header(path, find, "no row of units", "export the raw data again")
    separator = separator_of(lines.texts[first])
    names, units = (cells_of(text, separator) for text in lines.texts[first : first + 2])
    name, date = find_title(lines, first)
    columns, began = in_two_rows(names, units), seconds_of(date)
    return tables(columns, data, lines, path, first, first + 2, name=name, began=began)


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a row holds units, one of them of time and one of force or stress."""
    kinds = ("time", "force", "stress")
    present = {kind: any(unit_of(cell, kind) for cell in cells if cell.strip()) for kind in kinds}
    return present["time"] and (present["force"] or present["stress"])


def table(
    columns: Sequence[NamedColumn],
    rows: bytes,
    separator: str,
    file: Path,
    line: int,
    first: int,
    *,
    name: str = "",
    began: float | None = None,
) -> Recording:
    """Read the columns of time, displacement and force from rows of text."""
    picked = chosen(columns, file, line + 1)
    return _of_larger_motion(columns, picked, rows, separator, file, first, name, began)


def adjacent_tests(
    columns: Sequence[NamedColumn],
    rows: bytes,
    separator: str,
    file: Path,
    line: int,
    first: int,
    *,
    name: str = "",
    began: float | None = None,
    above: Sequence[str] = (),
) -> list[Recording]:
    """Return the tests that stand side by side in rows of text, mostly one."""
    tests = side_by_side(columns, chosen(columns, file, line + 1))
    return [
        _of_larger_motion(
            columns_of(columns, picked), picked, rows, separator, file, first,
            f"{name} {title}".strip(), began,
        )
        for picked, title in zip(tests, titles_of(tests, above), strict=True)
    ]  # fmt: skip


def by_specimen(
    columns: Sequence[NamedColumn], rows: bytes, separator: str, first: int
) -> tuple[Sequence[NamedColumn], list[tuple[str, int, bytes]]]:
    """Return the other columns, and rows cut where a column of specimens or tests changes."""
    whole = [("", first, rows)]
    column = next((c for c in columns if _SPECIMEN.fullmatch(plain_name(c.name))), None)
    if column is None:
        return columns, whole
    parts: list[tuple[str, int, list[bytes]]] = []
    for number, line in enumerate(rows.split(b"\n"), first):
        cells = cells_of(line.decode("utf-8", "replace"), separator)
        label = cells[column.index] if column.index < len(cells) else ""
        if not parts or (label and label != parts[-1][0]):
            parts.append((label, number, []))
        parts[-1][2].append(line)
    if not 1 < len(parts) <= _MOST_TESTS or any(len(lines) < _LEAST for *_, lines in parts):
        return columns, whole
    others = [one for one in columns if one is not column]
    named = [label if not label.isdigit() else f"{column.name} {label}" for label, *_ in parts]
    return others, [
        (name, line, b"\n".join(lines) + b"\n")
        for name, (_, line, lines) in zip(named, parts, strict=True)
    ]


def tables(
    columns: Sequence[NamedColumn],
    data: bytes,
    lines: Lines,
    file: Path,
    line: int,
    first: int,
    *,
    name: str = "",
    began: float | None = None,
) -> tuple[Recording, ...]:
    """Return the tests below a line of names, mostly one."""
    names = lines.texts[line]
    separator = separator_of(names)
    above = cells_of(lines.texts[line - 1], separator) if line else []
    below: list[list[Recording]] = []
    for start, rows in sections(data[lines.starts[first] :], names, first):
        refuse_other_header(rows, columns, separator, file, start)
        if below and rows.count(b"\n") < _LEAST:  # names left over at the end
            continue
        tests = adjacent_tests(
            columns, rows, separator, file, line, start, name=name, began=began, above=above
        )
        if below and all(_goes_on(*pair) for pair in zip(below[-1], tests, strict=True)):
            below[-1] = [_together(*pair) for pair in zip(below[-1], tests, strict=True)]
        else:
            below.append(tests)
    if len(below) == 1:
        return tuple(below[0])
    return tuple(
        replace(test, name=f"{test.name} {number}".strip())
        for number, tests in enumerate(below, 1)
        for test in tests
    )


def _goes_on(before: Recording, after: Recording) -> bool:
    return bool(after.time.values[0] >= before.time.values[-1])


def _together(before: Recording, after: Recording) -> Recording:
    """Return two parts of one test as one."""
    pairs = {part: (getattr(before, part), getattr(after, part)) for part in _PARTS}
    joined = {
        part: replace(one, values=np.append(one.values, other.values))
        for part, (one, other) in pairs.items()
    }
    dropped = Counter(before.dropped) + Counter(after.dropped)
    return replace(before, dropped=dict(dropped), **joined)


def recorded(
    columns: Sequence[NamedColumn],
    picked: dict[str, NamedColumn],
    rows: bytes,
    separator: str,
    file: Path,
    first: int,
    name: str,
    began: float | None = None,
) -> Recording:
    """Return the recording of the picked columns; ``first`` is the first row's line, from 0."""
    refuse_split_numbers(rows, separator, len(columns), file, first + 1)
    read = read_rows(rows, separator, [named.index for named in picked.values()], file, first + 1)
    own = on_clock(picked, read.clocks, file)
    return recording(columns, own, read.columns, read.dropped, name, began)


def _of_larger_motion(
    columns: Sequence[NamedColumn],
    picked: dict[str, NamedColumn],
    rows: bytes,
    separator: str,
    file: Path,
    first: int,
    name: str,
    began: float | None,
) -> Recording:
    """Return the recording of the picked columns; of a rheometer's two motions the larger."""
    squeezed = recorded(columns, picked, rows, separator, file, first, name, began)
    if (other := sheared_instead(columns, picked)) is None:
        return squeezed
    sheared = recorded(columns, other, rows, separator, file, first, name, began)
    return that_moved(squeezed, sheared, file)


def refuse_other_header(
    rows: bytes, columns: Sequence[NamedColumn], separator: str, file: Path, first: int
) -> None:
    """Raise InputError where names or units appear among rows that are not those of the columns."""
    for found in _LETTERS.finditer(rows):
        line = rows[found.start() : rows.find(b"\n", found.start())].decode("utf-8", "replace")
        cells = cells_of(line, separator)
        if len(cells) < len(_PARTS) or any(map(is_like_number, cells)):
            continue
        named, units = in_cells(cells), in_two_rows([""] * len(cells), cells)
        is_header = all(measured(named).values()) and not _agree(named, columns)
        if is_header or (are_units(cells) and not _agree(units, columns)):
            shown = line.strip()[:_SHOWN]
            raise InputError(
                f"names or units other than those above begin here ('{shown}')",
                file=file,
                line=first + 1 + rows.count(b"\n", 0, found.start()),
                remedy="export each test to a file of its own",
            )


def _agree(found: Sequence[NamedColumn], columns: Sequence[NamedColumn]) -> bool:
    """Return whether names and units, as far as they are written, are those of the columns."""
    pairs = [(one, other) for one, other in zip(found, columns, strict=False)]
    return all(
        one.name in ("", other.name) and ("" in (one.unit, other.unit) or one.unit == other.unit)
        for one, other in pairs
    )


def seconds_of(text: str) -> float | None:
    """Return a date as seconds since 1970 on the machine's clock, or None where it is unclear."""
    for form in _DATES:
        try:
            return datetime.strptime(text.strip(), form).replace(tzinfo=UTC).timestamp()
        except ValueError:
            continue
    return None
