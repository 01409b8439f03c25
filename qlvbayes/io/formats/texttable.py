"""Read tables in a text: names, units and rows of numbers become recordings, one for each test."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.columns import (
    NamedColumn,
    chosen,
    columns_of,
    in_cells,
    in_two_rows,
    measured,
    on_clock,
    plain_name,
    recording,
    refuse_unknown_unit,
    sheared_instead,
    side_by_side,
    that_moved,
    titles_of,
)
from qlvbayes.io.formats.format import Channel, Recording
from qlvbayes.io.formats.machineunits import unit_of
from qlvbayes.io.formats.textfile import (
    SHOWN,
    Lines,
    are_numbers,
    cells_of,
    is_like_number,
    sections,
    separator_of,
)
from qlvbayes.io.formats.textrows import read_rows, refuse_split_numbers
from qlvbayes.io.reading.header import LABELS, is_tidy_name

_NAMES = 3  # of time, displacement and force
_BLANK = 2  # most empty rows between the names and their units
_LEAST = 10  # lines that a test has at least below repeated names
_HEADER = 60  # lines among which the names of columns are
_BRACKETED = re.compile(r"\s*[\[(][^\[\]()]*[\])]\s*$")
_LETTERS = re.compile(rb"(?m)^[\"'(\[# ]*[^\d\s.,;+\-][^\n]*$")  # lines that begin with a letter
_MOST_TESTS = 200  # of one file: a column that changes more often is a counter
_SPECIMEN = re.compile(
    r"(specimen|sample|probe|prufling|eprouvette|echantillon|probeta|muestra|provino|campione|pad"
    r"|test|trial|run|versuch|essai|prova|ensayo)( ?(id|name|label|number|no|nr|nummer|numero))?"
)
_PARTS = ("time", "way", "load")
_SAME = 0.05  # of the travel, and of the force's range, within which a block goes on,
_LOADED = 0.1  # and of the largest force, above which a test has not ended
_NONE = "\0"  # no line of a file is equal to it


@dataclass(frozen=True)
class Header:
    """Where a table begins: the lines of its names and of its first row (from 0), its columns.

    ``line`` is ``first`` where there are no names. ``picked`` are the columns of time, displacement
    (strain) and force (stress) where they are known already, and ``clock`` is the force's own.
    """

    line: int
    first: int
    columns: Sequence[NamedColumn]
    picked: dict[str, NamedColumn] | None = None
    clock: NamedColumn | None = None


FindHeader = Callable[[Lines, bool], Header | None]
"""Function of a text's first lines, and of whether blanks separate its cells."""


def find_header(lines: Lines, blanks: bool = False, *, tidy: bool = False) -> Header | None:
    """Return the first row that names time, displacement and force, with units or numbers below.

    The names of a tidy file count where ``tidy`` is true. Units are in the row of names, in that
    below or in that above.
    """
    rows = list(lines.cells())
    for number, names in rows:
        if not may_name(names):
            continue
        if not tidy and any(name in LABELS if blanks else is_tidy_name(name) for name in names):
            continue
        in_row = in_cells(names)
        by_quantity = measured(in_row).values()
        if all(named and named.unit for named in by_quantity):
            return _shifted(Header(number, number + 1, in_row), lines)
        below = next((k for k, cells in rows[number + 1 :][: _BLANK + 1] if any(cells)), None)
        if below is None:
            continue
        numbers = are_numbers(
            rows[below][1], [named.index for named in by_quantity if named] or [0]
        )
        if numbers and number and are_units(rows[number - 1][1]):
            columns = in_two_rows(names, rows[number - 1][1])
            if all(named and named.unit for named in measured(columns).values()):
                return Header(number, number + 1, columns)
        if all(by_quantity) and numbers:
            return _shifted(Header(number, number + 1, in_row), lines)
        separator = separator_of(lines.texts[number])
        columns = in_two_rows(names, cells_of(lines.texts[below], separator))
        if all(named and named.unit for named in measured(columns).values()):
            return Header(number, below + 1, columns)
    return None


def any_header(lines: Lines, blanks: bool) -> Header | None:
    """Return the header as `find_header` does, where a table may have the names of a tidy file."""
    return find_header(lines, blanks, tidy=True)


def may_name(cells: Sequence[str]) -> bool:
    """Return whether three cells are neither empty nor numbers, as names are."""
    return sum(bool(cell) and not is_like_number(cell) for cell in cells) >= _NAMES


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a row holds units, one of them of time and one of force or stress."""
    kinds = ("time", "force", "stress")
    present = {kind: any(unit_of(cell, kind) for cell in cells if cell.strip()) for kind in kinds}
    return present["time"] and (present["force"] or present["stress"])


def refuse_unknown_units(lines: Lines, file: Path) -> None:
    """Raise InputError where a row names time, displacement and force, one in an unknown unit."""
    rows = list(lines.cells())[:_HEADER]
    for (number, names), below in zip(rows, [*(cells for _, cells in rows[1:]), []], strict=True):
        bare = [_BRACKETED.sub("", name) for name in names]
        if len(names) < _NAMES or not all(measured(in_two_rows(bare, [])).values()):
            continue
        refuse_unknown_unit(in_cells(names), file, number + 1)
        if not any(character.isdigit() for cell in below for character in cell):
            refuse_unknown_unit(in_two_rows(names, below), file, number + 2)


def _shifted(header: Header, lines: Lines) -> Header:
    """Return the header of rows that begin with their own name, which the names do not count."""
    separator = separator_of(lines.texts[header.line])
    rows = [cells_of(text, separator) for text in lines.texts[header.first :][:2] if text.strip()]
    labels = [row[0] for row in rows if len(row) == len(header.columns) + 1]
    counted = labels in (["1", "2"], ["0", "1"]) or not any(map(is_like_number, labels))
    if len(labels) < 2 or not counted or not all(map(is_like_number, rows[0][1:])):
        return header
    columns = [replace(column, index=column.index + 1) for column in header.columns]
    return replace(header, columns=columns)


def read_below(
    header: Header,
    data: bytes,
    lines: Lines,
    file: Path,
    *,
    above: int = 0,
    name: str = "",
    began: float | None = None,
    part: str = "",
) -> list[Recording]:
    """Return the tests of a text below its header, mostly one.

    Where the names are repeated and time goes on, the test goes on; where the clock begins anew, so
    does a test. ``above`` is the number of the file's lines before this text; ``part`` is what a
    part of several is called.
    """
    named = header.line < header.first
    names = lines.texts[header.line] if named else _NONE
    separator = separator_of(names if named else lines.texts[header.first])
    over = cells_of(lines.texts[header.line - 1], separator) if header.line else []
    units = "\n".join(lines.texts[header.line + 1 : header.first])
    width = max(column.index for column in header.columns) + 1
    parts: list[list[Recording]] = []
    for start, whole in sections(data[lines.starts[header.first] :], names, header.first):
        rows = _without_units(whole, units)
        line = above + start
        _refuse_other_header(rows, header.columns, separator, file, line)
        if parts and rows.count(b"\n") < _LEAST:  # names left over at the end
            continue
        refuse_split_numbers(rows, separator, width, file, line + 1)
        columns, specimens = _by_specimen(header, rows, separator, line)
        tests = [
            test
            for specimen, first, some in specimens
            for test in _side_by_side(
                replace(header, columns=columns, line=above + header.line), some, separator, file,
                first, f"{name} {specimen}".strip(), began, over,
            )
        ]  # fmt: skip
        if parts and _goes_on(parts[-1], tests, file, line):
            parts[-1] = [_together(*pair) for pair in zip(parts[-1], tests, strict=True)]
        else:
            parts.append(tests)
    if len(parts) == 1:
        return parts[0]
    return [
        replace(test, name=f"{part} {number} {test.name}".strip())
        for number, tests in enumerate(parts, 1)
        for test in tests
    ]


def _without_units(rows: bytes, units: str) -> bytes:
    """Return rows below repeated names with an empty line in place of the repeated units."""
    mark = units.encode()
    if mark.strip() and rows.startswith(mark + b"\n"):
        return b"\n" * (mark.count(b"\n") + 1) + rows[len(mark) + 1 :]
    return rows


def _side_by_side(
    header: Header,
    rows: bytes,
    separator: str,
    file: Path,
    first: int,
    name: str,
    began: float | None,
    above: Sequence[str],
) -> list[Recording]:
    """Return the tests that stand side by side in rows of text, mostly one."""
    picked = header.picked or chosen(header.columns, file, header.line + 1)
    tests = [picked] if header.picked else side_by_side(header.columns, picked)
    found = []
    for one, title in zip(tests, titles_of(tests, above), strict=True):
        own = replace(header, columns=columns_of(header.columns, one), picked=one)
        test = _recorded(own, rows, separator, file, first, f"{name} {title}".strip(), began)
        other = None if header.picked else sheared_instead(own.columns, one)
        if other is not None:
            sheared = replace(own, picked=other)
            test = that_moved(
                test, _recorded(sheared, rows, separator, file, first, test.name, began), file
            )
        found.append(test)
    return found


def _recorded(
    header: Header,
    rows: bytes,
    separator: str,
    file: Path,
    first: int,
    name: str,
    began: float | None,
) -> Recording:
    """Return the recording of the picked columns; ``first`` is the first row's line, from 0."""
    picked = header.picked or {}
    indices = [named.index for named in picked.values()]
    wanted = [*indices, header.clock.index] if header.clock else indices
    read = read_rows(rows, separator, wanted, file, first + 1)
    own = on_clock(picked, read.clocks, file)
    test = recording(header.columns, own, read.columns[:_NAMES], read.dropped, name, began)
    if header.clock is None:
        return test
    clock = Channel("time", read.columns[_NAMES], header.clock.unit, header.clock.name)
    unused = tuple(one for one in test.unused if one != header.clock.name)
    return replace(test, load_time=clock, unused=unused)


def _by_specimen(
    header: Header, rows: bytes, separator: str, first: int
) -> tuple[Sequence[NamedColumn], list[tuple[str, int, bytes]]]:
    """Return the other columns, and rows cut where a column of specimens or tests changes."""
    whole = [("", first, rows)]
    columns = header.columns
    column = next((c for c in columns if _SPECIMEN.fullmatch(plain_name(c.name))), None)
    if column is None or header.picked:
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


def _goes_on(
    before: Sequence[Recording], after: Sequence[Recording], file: Path, line: int
) -> bool:
    """Return whether a part below repeated names goes on with the tests of the part before.

    It does where time does. Where the clock begins anew although displacement and force go on under
    load, nobody knows how long the pause was: that is refused.
    """
    if len(before) != len(after):
        return False
    pairs = list(zip(before, after, strict=True))
    if all(new.time.values[0] >= old.time.values[-1] for old, new in pairs):
        return True
    if all(_continues(old, new) for old, new in pairs):
        what = "the clock begins anew here, and displacement and force go on from the rows above"
        remedy = "export the test with one clock, or each part to a file of its own if the " \
            "specimen was unloaded between them"  # fmt: skip
        raise InputError(what, file=file, line=line, remedy=remedy)
    return False


def _continues(old: Recording, new: Recording) -> bool:
    way, load = old.way.values, old.load.values
    peak = float(np.abs(load).max())
    if peak == 0.0 or abs(float(load[-1])) < _LOADED * peak:
        return False
    moved = abs(float(new.way.values[0] - way[-1])) > _SAME * float(np.ptp(way))
    return not moved and abs(float(new.load.values[0] - load[-1])) < 2.0 * _SAME * peak


def _together(before: Recording, after: Recording) -> Recording:
    """Return two parts of one test as one."""
    joined = {}
    for part in (*_PARTS, "load_time"):
        one, other = getattr(before, part), getattr(after, part)
        if one is not None:
            joined[part] = replace(one, values=np.append(one.values, other.values))
    dropped = Counter(before.dropped) + Counter(after.dropped)
    return replace(before, dropped=dict(dropped), **joined)


def _refuse_other_header(
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
            raise InputError(
                f"names or units other than those above begin here ('{line.strip()[:SHOWN]}')",
                file=file,
                line=first + 1 + rows.count(b"\n", 0, found.start()),
                remedy="export each test to a file of its own",
            )


def _agree(found: Sequence[NamedColumn], columns: Sequence[NamedColumn]) -> bool:
    """Return whether names and units, as far as they are written, are those of the columns."""
    return all(
        one.name in ("", other.name) and ("" in (one.unit, other.unit) or one.unit == other.unit)
        for one, other in zip(found, columns, strict=False)
    )
