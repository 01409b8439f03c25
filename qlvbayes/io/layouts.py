"""Read machines' texts: one row for each layout, and one reader for all of them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import (
    LABELS,
    NamedColumn,
    chosen,
    in_cells,
    in_two_rows,
    is_tidy_name,
    measured,
    on_clock,
    plain_name,
    quantities,
    recording,
    sheared_instead,
    side_by_side,
    unsure_of_columns,
)
from qlvbayes.io.recording import Channel, Recording, Sight
from qlvbayes.io.stated import stated_above
from qlvbayes.io.table import (
    SHOWN,
    Form,
    Lines,
    are_numbers,
    cells_of,
    content,
    decoded,
    is_like_number,
    read_rows,
    separator_of,
    with_tabs,
)
from qlvbayes.io.units import QUANTITIES, unit_of
from qlvbayes.io.wording import joined

_NAMES = 3  # of time, displacement and force
_SAME = 0.05  # of the travel, and of the force's range, within which a block goes on,
_LOADED = 0.1  # and of the largest force, above which a test has not ended
_BLANK = 2  # most empty rows between the names and their units
LEAST = 10  # lines that a test has at least
_HEADER = 60  # lines among which the names of columns are
_MOST_TESTS = 200  # of one file: a column that changes more often is a counter
_LETTERS = re.compile(rb"(?m)^[\"'(\[# ]*[^\d\s.,;+\-][^\n]*$")  # lines that begin with a letter
_SPECIMEN = re.compile(
    r"(specimen|sample|probe|prufling|eprouvette|echantillon|probeta|muestra|provino|campione|pad"
    r"|test|trial|run|versuch|essai|prova|ensayo)( ?(id|name|label|number|no|nr|nummer|numero))?"
)
_QUANTITIES = ("time", "displacement", "force")


# Where a table begins


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
        if sum(bool(cell) and not is_like_number(cell) for cell in names) < _NAMES:
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
        used = [named.index for named in by_quantity if named] or [0]
        numbers = are_numbers(rows[below][1], used)
        if numbers and number and _are_units(rows[number - 1][1]):
            columns = in_two_rows(names, rows[number - 1][1])
            if all(named and named.unit for named in measured(columns).values()):
                return Header(number, number + 1, columns)
        if all(by_quantity) and numbers:
            return _shifted(Header(number, number + 1, in_row), lines)
        columns = in_two_rows(
            names, cells_of(lines.texts[below], separator_of(lines.texts[number]))
        )
        if all(named and named.unit for named in measured(columns).values()):
            return Header(number, below + 1, columns)
    return None


def any_header(lines: Lines, blanks: bool) -> Header | None:
    """Return the header as `find_header` does, where a table may have the names of a tidy file."""
    return find_header(lines, blanks, tidy=True)


def _are_units(cells: Sequence[str]) -> bool:
    """Return whether a row holds units, one of them of time and one of force or stress."""
    kinds = ("time", "force", "stress")
    there = {kind for kind in kinds for cell in cells if cell.strip() and unit_of(cell, kind)}
    return "time" in there and len(there) > 1


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


def columns_in(lines: Lines) -> list[NamedColumn]:
    """Return the columns of the first table; empty where there is none, of two or more."""
    for number, cells in lines.cells():
        if len(cells) > 1 and are_numbers(cells, range(min(len(cells), _NAMES))):
            named = _names_above(lines, number, len(cells))
            return _columns(named, len(cells)) if named or len(cells) >= _NAMES else []
    return []


def _columns(named: Sequence[Sequence[str]], width: int) -> list[NamedColumn]:
    """Return columns by the rows of names and units above them, or else by their numbers."""
    if not named:
        return [NamedColumn(k, f"column {k + 1}", "") for k in range(width)]
    return in_two_rows(*named) if len(named) > 1 else in_cells(named[0])


# Columns that the user states


def named_columns(text: str) -> tuple[str, str, str]:
    """Return ``t,x,F`` as the columns of time, displacement (or strain) and force (or stress)."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != _NAMES or len({*parts, ""}) != _NAMES + 1:
        raise InputError(
            f"--columns {text[:200]!r} are not three different columns",
            remedy="write the names of time, displacement and force as t,x,F, or their numbers "
            "from 1 as 1,2,3",
        )
    return parts[0], parts[1], parts[2]


def stated_header(lines: Lines, stated: Sequence[str], file: Path) -> Header:
    """Return the header of the table that has the stated columns; an InputError says what lacks."""
    for first, cells in lines.cells():
        named = _names_above(lines, first, len(cells))
        columns = _columns(named, len(cells))
        indices = [k for name in stated for k in _stated(name, named, columns)]
        if len(indices) == _NAMES and are_numbers(cells, indices):
            picked = {key: columns[k] for key, k in zip(_QUANTITIES, indices, strict=True)}
            return Header(first - len(named), first, columns, picked)
    widest = max((cells for _, cells in lines.cells()), key=len, default=[])
    shown = f" (the file has: {', '.join(widest)[:200]})" if len(widest) > 1 else ""
    raise InputError(
        f"the columns {joined(list(stated))} are not there{shown}",
        file=file,
        remedy="write them as the file does, or their numbers from 1, as --columns 1,2,3",
    )


def _stated(name: str, named: Sequence[list[str]], columns: Sequence[NamedColumn]) -> list[int]:
    """Return the index of a stated column: by its name, with or without its unit, or number."""
    cells = [*named[0], *[""] * len(columns)] if named else [""] * len(columns)
    words = [(k, {cells[k], column.name}) for k, column in enumerate(columns)]
    alike = [k for k, own in words if name in own][:1] or [
        k for k, own in words if plain_name(name) in map(plain_name, own)
    ]
    if not alike and name.isdecimal() and 0 < int(name) <= len(columns):
        return [int(name) - 1]
    return alike if len(alike) == 1 else []


def _names_above(lines: Lines, first: int, width: int) -> list[list[str]]:
    """Return the row of names, and that of units, directly above a first row of numbers."""
    separator = separator_of(lines.texts[first])
    above = [cells_of(text, separator) for text in lines.texts[max(first - 2, 0) : first]]
    rows = [row for row in above if width <= len(row) <= width + 1]
    rows = [row for row in rows if not any(map(is_like_number, row))]
    kinds = [kind for either in QUANTITIES for kind in either]
    units = any(unit_of(cell, kind) for row in rows[-1:] for cell in row for kind in kinds)
    return rows if units else rows[-1:]


# Rows


def read_below(
    header: Header, data: bytes, lines: Lines, file: Path, name: str, above: int, part: str
) -> list[Recording]:
    """Return the tests of a text below its header, mostly one.

    Where the names are repeated and time goes on, the test goes on; where the clock begins anew, so
    does a test. ``above`` is the number of the file's lines before this text; ``part`` is what a
    part of several is called.
    """
    names = lines.texts[header.line] if header.line < header.first else "\0"
    separator = separator_of(lines.texts[header.line])
    units = "\n".join(lines.texts[header.line + 1 : header.first]).encode()
    first = above + header.first + 1
    parts: list[list[Recording]] = []
    for rows in re.split(b"(?m)^" + re.escape(names.encode()) + b"\n", _from(data, lines, header)):
        if units.strip() and rows.startswith(units + b"\n"):
            rows = b"\n" * (units.count(b"\n") + 1) + rows[len(units) + 1 :]
        if not parts or rows.count(b"\n") >= LEAST:  # else names left over at the end
            _refuse_other_header(rows, header.columns, separator, file, first)
            tests = _tests(header, rows, separator, file, first, name, lines, above)
            if parts and _goes_on(parts[-1], tests, file, first - 1):
                parts[-1] = [_together(*pair) for pair in zip(parts[-1], tests, strict=True)]
            else:
                parts.append(tests)
        first += rows.count(b"\n") + 1
    if len(parts) == 1:
        return parts[0]
    return [
        replace(test, name=f"{part} {number} {test.name}".strip())
        for number, tests in enumerate(parts, 1)
        for test in tests
    ]


def _from(data: bytes, lines: Lines, header: Header) -> bytes:
    return data[lines.starts[header.first] :]


def _tests(
    header: Header,
    rows: bytes,
    separator: str,
    file: Path,
    first: int,
    name: str,
    lines: Lines,
    above: int,
) -> list[Recording]:
    """Return the tests in rows: side by side, or one for each stretch of a specimen's name."""
    columns = header.columns
    picked = header.picked or chosen(columns, file, above + header.line + 1)
    groups = [picked] if header.picked else side_by_side(columns, picked)
    label = next((c for c in columns if _SPECIMEN.fullmatch(plain_name(c.name))), None)
    if header.picked or len(groups) > 1:
        label = None
    over = cells_of(lines.texts[header.line - 1], separator) if header.line else []
    width = max(column.index for column in columns) + 1
    found = []
    for title, one in zip(_titles(groups, over), groups, strict=True):
        sheared = None if header.picked else sheared_instead(columns, one)
        numbers = [(c.index, c.name) for c in (*one.values(), *(sheared or {}).values())]
        if header.clock is not None:
            numbers.append((header.clock.index, header.clock.name))
        form = Form(separator, numbers, [] if label is None else [label.index], names=width)
        read = read_rows(rows, form, file, first)
        values = read.columns[:_NAMES]
        if sheared and _shear_moved(values[1], read.columns[_NAMES + 1], sheared["strain"]):
            one, values = sheared, read.columns[_NAMES:]
        own = on_clock(one, read.clocks, file)
        test = recording(columns, own, values, read.dropped, f"{name} {title}".strip())
        if header.clock is not None:
            clock = header.clock
            unused = tuple(c for c in test.unused if c != clock.name)
            own_time = Channel("time", read.columns[_NAMES], clock.unit, clock.name)
            test = replace(test, load_time=own_time, unused=unused)
        if label is None:
            found.append(test)
        else:
            found += _by_specimen(test, label, read.labels[0].codes, read.labels[0].texts)
    return found


def _shear_moved(gap: Floats, strain: Floats, named: NamedColumn) -> bool:
    """Return whether a rheometer sheared a specimen rather than squeezed it."""
    unit = unit_of(named.unit, "strain")
    squeezed = float(np.ptp(gap)) / max(float(np.abs(gap).max()), 1e-300)
    return float(np.ptp(strain)) * (unit.factor if unit else 1.0) > squeezed


def _by_specimen(
    test: Recording, label: NamedColumn, codes: np.ndarray, texts: Sequence[str]
) -> list[Recording]:
    """Return a test for each stretch of rows with one name of a specimen, or the test itself."""
    cuts = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
    if not 2 < len(cuts) <= _MOST_TESTS + 1 or min(np.diff(cuts)) < LEAST:
        return [test]
    tests = []
    for begin, end in pairwise(cuts):
        text = texts[codes[begin]]
        own = f"{label.name} {text}" if text.isdigit() else text
        time, way, load = (
            replace(channel, values=channel.values[begin:end])
            for channel in (test.time, test.way, test.load)
        )
        unused = tuple(name for name in test.unused if name != label.name)
        dropped = {} if begin else test.dropped
        full = f"{test.name} {own}".strip()
        of_part = replace(test, time=time, way=way, load=load, name=full)
        tests.append(replace(of_part, dropped=dropped, unused=unused))
    return tests


def _titles(groups: Sequence[object], above: Sequence[str]) -> list[str]:
    """Return a name for each of several tests side by side: from the row above, or its number."""
    if len(groups) == 1:
        return [""]
    titles = list(dict.fromkeys(title.strip() for title in above if title.strip()))
    return titles if len(titles) == len(groups) else [str(k + 1) for k in range(len(groups))]


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
        remedy = (
            "export the test with one clock, or each part to a file of its own if the specimen was "
            "unloaded between them"
        )
        raise InputError(what, file=file, line=line, remedy=remedy)
    return False


def _continues(old: Recording, new: Recording) -> bool:
    """Return whether a part begins where the part before ended, which was still loaded."""
    way, load = old.way.values, old.load.values
    peak = float(np.abs(load).max())
    if abs(float(load[-1])) < _LOADED * peak or peak == 0.0:
        return False
    moved = abs(float(new.way.values[0] - way[-1])) > _SAME * float(np.ptp(way))
    return not moved and abs(float(new.load.values[0] - load[-1])) < 2.0 * _SAME * peak


def _together(before: Recording, after: Recording) -> Recording:
    """Return two parts of one test as one."""
    joint = {
        key: replace(one, values=np.append(one.values, getattr(after, key).values))
        for key in ("time", "way", "load", "load_time")
        if (one := getattr(before, key)) is not None
    }
    dropped = Counter(before.dropped) + Counter(after.dropped)
    return replace(before, dropped=dict(dropped), **joint)


def _refuse_other_header(
    rows: bytes, columns: Sequence[NamedColumn], separator: str, file: Path, first: int
) -> None:
    """Raise InputError where names or units other than those of the columns appear among rows."""
    for found in _LETTERS.finditer(rows):
        text = found[0].decode("utf-8", "replace")
        cells = cells_of(text, separator)
        if len(cells) < _NAMES or any(map(is_like_number, cells)):
            continue
        same = [cell.strip("()[]") for cell in cells] == [column.unit for column in columns]
        named = in_cells(cells)
        pairs = zip(named, columns, strict=False)
        agree = all(one.name in ("", other.name) for one, other in pairs)  # a cut file's last line
        if (all(measured(named).values()) and not agree) or (_are_units(cells) and not same):
            raise InputError(
                f"names or units other than those above begin here ('{text.strip()[:SHOWN]}')",
                file=file,
                line=first + rows.count(b"\n", 0, found.start()),
                remedy="export each test to a file of its own",
            )


# Layouts

Shown = str | Callable[[Lines], bool]
"""Mark of a layout: a pattern that the first bytes have, or a function of their lines."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Layout of the text files of a testing machine or program, as one row of a table.

    ``name``, ``machine``, ``marks``, ``reads``, ``reference`` and ``general`` are as in
    `AbstractFormat`. ``shows`` are the marks in words, each with its pattern. The table begins
    below ``after``; ``header`` finds its names. ``block`` divides the text into its groups ``head``
    and ``rows``, where each block is a test of its own. ``title`` is a pattern whose groups are the
    test's name; ``part`` is what one of several parts is called.
    ``prepare`` makes the text a table where it is none, line by line. ``pressing`` is whether the
    layout fixes the signs of displacement and force. ``lacking`` is what a file without a header
    lacks, and the remedy.
    """

    name: str
    machine: str
    marks: str
    reads: str
    reference: str
    shows: Mapping[str, Shown]
    general: bool = False
    after: str = ""
    header: FindHeader = any_header
    block: str = ""
    title: str = ""
    part: str = ""
    prepare: Callable[[bytes], bytes] = bytes
    pressing: bool = False
    lacking: tuple[str, str] = ("no row of names with units", "export the curves again")

    def sniff(self, head: bytes) -> Sight:
        """Return which marks of the layout the first bytes of a file show."""
        text = decoded(head)
        lines = Lines.from_bytes(text.encode())
        return Sight.from_marks(
            {
                mark: bool(re.search(shown, text)) if isinstance(shown, str) else shown(lines)
                for mark, shown in self.shows.items()
            }
        )

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the tests of one file, in its order."""
        return tuple(self.tests_in(content(path), path))

    def tests_in(self, data: bytes, path: Path, name: str = "") -> list[Recording]:
        """Return the tests of a text, whose names begin with ``name``."""
        blocks = list(self._blocks(self.prepare(data)))
        if not blocks:
            raise InputError(
                "there is no block <DATA> with rows", file=path, remedy=self.lacking[1]
            )
        tests: list[Recording] = []
        for number, (head, above, rows) in enumerate(blocks, 1):
            title = _found(self.title, head)
            own = f"{number} {title}" if len(blocks) > 1 else title
            found = self._tests(head, above, rows, path, f"{name} {own}".strip())
            tests += [replace(test, pressing=self.pressing or test.pressing) for test in found]
        return tests

    def _blocks(self, data: bytes) -> Iterator[tuple[str, int, bytes]]:
        """Yield each block: what is above its table, the number of lines there, and the rest."""
        if not self.block:
            yield data[:20_000].decode("utf-8", "replace"), 0, data
            return
        for found in re.finditer(self.block.encode(), data, re.DOTALL | re.MULTILINE):
            if found["rows"].count(b"\n") > LEAST:
                rows = re.sub(rb"(?m)^<[^>\n]*>[^\n]*$", b"", found["rows"])  # marks of its parts
                head = found["head"].decode("utf-8", "replace")
                yield head, data.count(b"\n", 0, found.start("rows")), rows

    def _tests(self, head: str, above: int, data: bytes, path: Path, name: str) -> list[Recording]:
        data, blanks = with_tabs(data) if self.general else (data, False)
        lines = Lines.from_bytes(data)
        start = 0
        if self.after:
            texts = enumerate(lines.texts, 1)
            start = next((n for n, text in texts if re.match(self.after, text)), 0)
        header = self.header(Lines(("",) * start + lines.texts[start:], lines.starts), blanks)
        if header is None:
            if columns := columns_in(lines):
                raise unsure_of_columns(columns, path)
            raise InputError(self.lacking[0], file=path, remedy=self.lacking[1])
        stated = stated_above(head.split("\n") if self.block else lines.texts[: header.line])
        tests = read_below(header, data, lines, path, name, above, self.part)
        return [replace(test, stated=stated) for test in tests]


def _found(pattern: str, text: str) -> str:
    """Return the groups of a pattern where a text has it; empty otherwise."""
    match = re.search(pattern, text) if pattern else None
    return " ".join(group.strip(' "') for group in match.groups() if group) if match else ""


def _names_time_and(lines: Lines, force: str) -> bool:
    """Return whether a row names a time, and a force by such a word."""
    for _, cells in lines.cells():
        columns = in_cells(cells)
        by_quantity = quantities([replace(column, unit="") for column in columns])
        load = any(re.fullmatch(force, plain_name(column.name)) for column in columns)
        if "time" in by_quantity and (load or (not force and {"force", "stress"} & {*by_quantity})):
            return True
    return False


def _has_table(lines: Lines) -> bool:
    data, blanks = with_tabs("\n".join(lines.texts).encode())
    return find_header(Lines.from_bytes(data), blanks) is not None


# Two clocks

_CLOCK = r"(t|time|clock|timestamp|zeit)( .*)?|.* (t|time|clock|timestamp)"
_OF_LOAD = r"(.* )?(force|load|f|fz|cell|loadcell|stress|kraft)( .*)?"
_OF_WAY = (
    r"(.* )?(disp|displacement|d|position|pos|encoder|stage|platen|strain|extension|weg|x|z)( .*)?"
)


def _clocks(lines: Lines) -> tuple[int, list[NamedColumn], list[NamedColumn]]:
    """Return the first line that is no comment, the columns that it names, and their clocks."""
    for number, text in enumerate(lines.texts):
        if text.strip() and not text.startswith(("#", "%")):
            columns = in_cells(cells_of(text, separator_of(text)))
            return number, columns, [c for c in columns if re.fullmatch(_CLOCK, plain_name(c.name))]
    return 0, [], []


def _two_clock_header(lines: Lines, blanks: bool = False) -> Header | None:
    """Return a header with a clock for each channel, of which the names say which is whose."""
    number, columns, clocks = _clocks(lines)
    by_quantity = measured([c for c in columns if c not in clocks])
    by_quantity.pop("time")
    if len(clocks) != 2 or not all(by_quantity.values()):
        return None
    named = [plain_name(clock.name) for clock in clocks]
    of_load = [bool(re.fullmatch(_OF_LOAD, name)) for name in named]
    of_way = [bool(re.fullmatch(_OF_WAY, name)) for name in named]
    if all(of_load) or all(of_way) or of_load == of_way:
        return None
    way, load = clocks if of_load[1] or of_way[0] else clocks[::-1]
    picked = {"time": way, **{key: one for key, one in by_quantity.items() if one}}
    return Header(number, number + 1, columns, picked, load)


# LabVIEW's own text


def _with_times(data: bytes) -> bytes:
    """Return LabVIEW's measurement file as a table: names with units, and the time of every row.

    Where the file has no column of time, a row's time is X0 + i Delta_X of its header, which names
    the units too. Each line stays at its number.
    """
    lines = data.decode("utf-8", "replace").split("\n")
    first = next((line for line in lines if line.startswith("Separator")), "")
    mark = "," if "comma" in first.lower() else "\t"
    settings: dict[str, list[str]] = {}
    row = -1  # of the numbers below the last header
    for k, line in enumerate(lines):
        key, *cells = [cell.strip() for cell in line.split(mark)]
        if key == "X_Value":
            units = settings.pop("Y_Unit_Label", [])
            units += [""] * len(cells)
            names = [f"{c} ({u})" if u else c for c, u in zip(cells, units, strict=False)]
            row, lines[k] = 0, mark.join(["Time (s)", *names])
        elif key in ("LabVIEW Measurement", "Channels"):
            row = -1
        elif row < 0:
            settings[key] = [cell for cell in cells if cell]
        elif line.strip():
            if not key and cells:
                begin, step = (_as_number(settings.get(name, [])) for name in ("X0", "Delta_X"))
                lines[k] = mark.join([f"{begin + row * step:.9g}", *cells])
            row += 1
    return "\n".join(lines).encode()


def _as_number(cells: Sequence[str]) -> float:
    try:
        return float(cells[0].replace(",", ".")) if cells else 0.0
    except ValueError:
        return 0.0


_RAW_DATA = r'(?i)"?(raw data|rohdaten|donn[eé]es brutes|datos sin procesar)[^,;\t]*"?[,;\t"]*$'
_STANDARD_FORCE = "standardkraft|standard force|force standard|fuerza estandar|forza standard"
_UNITS = r'(?m)^[,;\t]?("?\([^()\n]*\)"?[,;\t]?){3,}\s*$'
BLUEHILL_3 = Layout(
    "bluehill-3",
    "Instron, Bluehill 2 and 3 (raw data as CSV)",
    "a row of names with time, and a row of units, each in parentheses",
    "Time, (Compressive) Extension, (Compressive) Load; start time, label",
    "Bluehill 3 reference manual, exported raw data",
    {
        "a row of names with time and load": partial(_names_time_and, force=""),
        "units in parentheses in the row below": _UNITS,
    },
    title=r'(?im)^"?specimen label:?"?[,;\t]\s*"?([^"\n]*)',
)
BLUEHILL_UNIVERSAL = Layout(
    "bluehill-universal",
    "Instron, Bluehill Universal (results and raw data as CSV)",
    "a line 'Raw Data' and below it names with units in parentheses",
    "Time (s), Displacement (mm), Force (N) below 'Raw Data'",
    "Bluehill Universal, exported raw data",
    {
        "a line 'Raw Data'": f"(?m)^{_RAW_DATA}".replace("(?m)^(?i)", "(?mi)^"),
        "names with units in parentheses": r"(?m)^[^\n(]*\((s|sec|ms|min)\)[^\n(]+\(",
    },
    after=_RAW_DATA,
)
WINTEST = Layout(
    "wintest",
    "Bose or TA ElectroForce, WinTest (text)",
    "names with 'Elapsed Time', and units with 'Sec' in the row below",
    "Elapsed Time, Disp, Load of every scan (a test each)",
    "WinTest, exported data acquisition",
    {
        "names with 'Elapsed Time'": r'(?m)^([^,;\t\n]*[,;\t])?"?Elapsed Time"?[,;\t]',
        "'Sec' in the row below": r'Elapsed Time"?[,;\t][^\n]*\n([^\n]*[,;\t])?"?Sec"?[,;\t]',
    },
    part="scan",
)
TESTSUITE = Layout(
    "testsuite",
    "MTS TestSuite (data acquisition as CSV or text)",
    "lines 'Test Run:' and 'Date:'",
    "(Running) Time, (Axial) Displacement, (Axial) Force; run name and date",
    "MTS TestSuite, exported raw data",
    {
        "a line 'Test Run:'": r'(?m)^[ "]*Test Run(?: Name)?\s*:',
        "a line 'Date:'": r'(?m)^[ "]*Date(?: Name)?\s*:',
    },
    title=r'(?m)^[ "]*Test Run(?: Name)?\s*:[ \t",;]*([^"\n]*)',
)
TESTXPERT = Layout(
    "testxpert",
    "ZwickRoell, testXpert II and III (text: .txt, .tra, .csv)",
    "testXpert's own names (Standardkraft, Standard force) in addition to a time",
    "Prüfzeit or Test time, Standardweg or Standard travel, Standardkraft",
    "testXpert, export of curves",
    {
        "a row of names with Standardkraft or Standard force and a time": partial(
            _names_time_and, force=_STANDARD_FORCE
        ),
    },
)
CELLSCALE = Layout(
    "cellscale",
    "CellScale UniVert, MicroTester (data as CSV)",
    "columns SetName and Cycle in addition to Time_S",
    "Time_S, Displacement_mm or Tip_um, Force_N or Force_uN; sets and cycles are one test",
    "CellScale UniVert user manual, output columns",
    {
        "a column SetName": r"(?i)\A[^\n]*\bSet ?(Name)?\b",
        "a column Cycle": r"(?i)\A[^\n]*\bCycle\b",
        "a column Time_S": r"(?i)\A[^\n]*\bTime[ _]?\(?S\b",
    },
)
MACH_1 = Layout(
    "mach-1",
    "Biomomentum Mach-1 (text)",
    "a first line <Mach-1 File>, and a block <INFO>",
    "Time, s; Position (z), mm; Fz, gf or N, of every <DATA> block (a test)",
    "Mach-1 Motion user manual, data files",
    {"a first line <Mach-1 File>": r"\A\s*<Mach-1 File>", "a block <INFO>": "<INFO>"},
    block=r"<INFO>(?P<head>.*?)<END INFO>.*?<DATA>[ \t]*\n(?P<rows>.*?)(?:<END DATA>|\Z)",
    title=r"<(?!END)([^>/]+)>",
    lacking=("no row of names with units", "export the file again, with its data"),
)
CHIARO = Layout(
    "chiaro",
    "Optics11 Chiaro, Piuma (text)",
    "a line 'k (N/m)', and names with Load (uN) and Indentation (nm)",
    "Time (s), Indentation (nm), Load (uN); date",
    "Optics11 Life, Piuma and Chiaro user manual, data files",
    {
        "a line 'k (N/m)'": r"(?m)^k \(N/m\)",
        "names with Load and Indentation": r"(?m)^Time[^\n]*\tIndentation \(",
    },
    pressing=True,  # a tip is pressed in, and may stick
)
LVM = Layout(
    "lvm",
    "National Instruments LabVIEW, measurement file (.lvm)",
    "a first line 'LabVIEW Measurement', and a line '***End_of_Header***'",
    "channels by name or unit (Y_Unit_Label); X_Value, or else X0 + i Delta_X of the header",
    "National Instruments, Specification for the LabVIEW Measurement File",
    {
        "a first line 'LabVIEW Measurement'": r"\A\s*LabVIEW Measurement",
        "a line '***End_of_Header***'": r"(?m)^\*\*\*End_of_Header\*\*\*",
    },
    prepare=_with_times,
)
TWO_CLOCKS = Layout(
    "two-clocks",
    "a laboratory's own CSV with a clock for each channel",
    "two columns of time, one named after force or displacement; units",
    "displacement on its own clock, brought to the times of the force",
    "any logger that stamps its channels one by one",
    {
        "two columns of time": lambda lines: len(_clocks(lines)[2]) == 2,
        "one of them named after force or displacement, and both channels": lambda lines: (
            _two_clock_header(lines) is not None
        ),
    },
    header=_two_clock_header,
    lacking=("the two clocks cannot be distinguished", "name the clocks t_disp_s and t_force_s"),
)
TABLE = Layout(
    "table",
    "a table of named columns with units (rheometers, most programs)",
    "names of time, displacement or strain, force or stress, with units",
    "the three columns, units in brackets, in the row below or in that above, UTF-16 too",
    "Anton Paar RheoCompass, export of tables; ISO 6721-10 for the names",
    {
        "names of time, displacement or strain, and force or stress, with units or numbers below, "
        "and no name of a tidy file": _has_table,
    },
    general=True,
    header=find_header,
    lacking=("no row of names with units", "export it again"),
)


def stated_layout(stated: Sequence[str], file: Path, own: Layout | None) -> Layout:
    """Return the layout of a text of which the user states time, displacement and force.

    ``own`` is the layout that the file's marks show, if it has any: its text is made a table alike.
    """
    words = "three columns, which --columns states"
    return Layout(
        "columns",
        f"a table with the columns {joined(list(stated))}, as stated",
        words,
        "these columns; units after the names, below them, or by --units",
        "none: the user knows the file",
        {words: ""},
        general=True,
        header=lambda lines, _: stated_header(lines, stated, file),
        prepare=own.prepare if own else bytes,
    )
