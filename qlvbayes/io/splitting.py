"""Split the rows below a table's names into tests: side by side, one below another, by specimen."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import itemgetter
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import (
    NamedColumn,
    chosen,
    in_cells,
    measured,
    on_clock,
    plain_name,
    recording,
    sheared_instead,
    side_by_side,
)
from qlvbayes.io.header import NAMES, Header, are_units, named_specimen
from qlvbayes.io.readings import starts_on_one_clock
from qlvbayes.io.recording import Channel, Recording, Stated
from qlvbayes.io.table import SHOWN, Labels, RowForm, read_rows
from qlvbayes.io.text import Lines, cells_of, is_like_number, separator_of
from qlvbayes.io.units import unit_of

LEAST = 10  # lines that a test has at least
_SAME = 0.05  # of the travel, and of the force's range, within which a block goes on,
_LOADED = 0.1  # and of the largest force, above which a test has not ended
_MOST_TESTS = 200  # of one file: a column that changes more often is a counter
_RUNS_ON = "the column of times, which runs on from test to test"
_LETTERS = re.compile(rb"(?m)^[\"'(\[# ]*[^\d\s.,;+\-][^\n]*$")  # lines that begin with a letter
_NUMBERED = r"(n|no|nr|num|numero|number|nummer)"
_LABEL = re.compile(  # of which specimen a row is, or of which test of it
    rf"({_NUMBERED} (de |di |du |of )?)?((?P<specimen>specimen|sample|probe|prufling|eprouvette"
    r"|echantillon|probeta|muestra|provino|campione|pad)|test|trial|run|versuch|essai|prova|ensayo)"
    rf"( ?(id|name|label|{_NUMBERED}))?"
)


def tests_below(
    header: Header, data: bytes, lines: Lines, file: Path, name: str, above: int, part: str
) -> list[Recording]:
    """Return the tests of a text below its header, mostly one, whose names begin with ``name``.

    Where the names are repeated and time goes on, the test goes on; where the clock begins anew, so
    does a test. ``above`` is the number of the file's lines before this text; ``part`` is what a
    part of several is called.
    """
    table = _Table.below(header, lines, file, name, above)
    names = lines.texts[header.line] if header.line < header.first else "\0"
    units = "\n".join(lines.texts[header.line + 1 : header.first]).encode()
    first = above + header.first + 1
    parts: list[list[Recording]] = []
    below = data[lines.starts[header.first] :]
    for rows in re.split(b"(?m)^" + re.escape(names.encode()) + b"\n", below):
        if units.strip() and rows.startswith(units + b"\n"):
            rows = b"\n" * (units.count(b"\n") + 1) + rows[len(units) + 1 :]
        if not parts or rows.count(b"\n") >= LEAST:  # else names left over at the end
            table.refuse_other_header(rows, first)
            tests = table.tests(rows, first)
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


@dataclass(frozen=True)
class _Table:
    """Table whose tests are side by side in ``groups`` of columns, each with its title.

    ``labels`` are the columns that name specimens and tests, where there is one group.
    """

    header: Header
    separator: str
    file: Path
    name: str
    groups: Sequence[tuple[str, dict[str, NamedColumn]]]
    labels: Sequence[NamedColumn] = ()

    @classmethod
    def below(cls, header: Header, lines: Lines, file: Path, name: str, above: int) -> _Table:
        """Return the table below a header."""
        columns, separator = header.columns, separator_of(lines.texts[header.line])
        if header.picked is not None:
            return cls(header, separator, file, name, [("", header.picked)])
        groups = side_by_side(columns, chosen(columns, file, above + header.line + 1))
        if len(groups) == 1:
            labels = [c for c in columns if _LABEL.fullmatch(plain_name(c.name))]
            return cls(header, separator, file, name, [("", groups[0])], labels)
        over = cells_of(lines.texts[header.line - 1], separator) if header.line else []
        titles = list(dict.fromkeys(title.strip() for title in over if title.strip()))
        if len(titles) != len(groups):
            titles = [str(k + 1) for k in range(len(groups))]
        return cls(header, separator, file, name, list(zip(titles, groups, strict=True)))

    def tests(self, rows: bytes, first: int) -> list[Recording]:
        """Return the tests in rows, of which the first is on that line of the file."""
        columns, clock = self.header.columns, self.header.clock
        width = max(column.index for column in columns) + 1
        labels = [column.index for column in self.labels]
        if clock is not None:  # the header names the columns of one test
            ((_, picked),) = self.groups
            return [self._on_two_clocks(picked, clock, width, rows, first)]
        found = []
        for title, one in self.groups:
            sheared = None if self.header.picked else sheared_instead(columns, one)
            used = [*one.values(), *(sheared or {}).values()]
            form = RowForm(self.separator, [(c.index, c.name) for c in used], labels, names=width)
            read = read_rows(rows, form, self.file, first)
            values = read.columns[:NAMES]
            if sheared:  # a rheometer: it sheared the specimen where it squeezed it less
                unit = unit_of(sheared["strain"].unit, "strain")
                gap, strain = values[1], read.columns[NAMES + 1] * (unit.factor if unit else 1.0)
                if float(np.ptp(strain)) > np.ptp(gap) / max(float(np.abs(gap).max()), 1e-300):
                    one, values = sheared, read.columns[NAMES:]
            own = on_clock(one, read.clocks, self.file)
            test = recording(columns, own, values, read.dropped, f"{self.name} {title}".strip())
            test = replace(test, clock=read.clocks.get(0, ""))
            found += _by_label(test, self.labels, read.labels)
        return found

    def _on_two_clocks(
        self, picked: dict[str, NamedColumn], clock: NamedColumn, width: int, rows: bytes,
        first: int,
    ) -> Recording:  # fmt: skip
        """Return a test whose channels have clocks, and as many rows as each has readings."""
        columns = self.header.columns
        time, way, load = picked.items()
        both = []
        for pair in ((time[1], way[1]), (clock, load[1])):
            form = RowForm(self.separator, [(c.index, c.name) for c in pair], [], names=width)
            both.append(read_rows(rows, form, self.file, first))
        (way_time, displacement), (load_time, force) = (one.columns for one in both)
        dropped = both[0].dropped | both[1].dropped
        own = on_clock(picked, both[0].clocks, self.file)
        clock = on_clock({"time": clock}, both[1].clocks, self.file)["time"]
        test = recording(columns, own, [way_time, displacement, force], dropped, self.name)
        unused = tuple(c for c in test.unused if c != clock.name)
        return replace(
            test, load_time=Channel("time", load_time, clock.unit, clock.name), unused=unused
        )

    def refuse_other_header(self, rows: bytes, first: int) -> None:
        """Raise InputError where names or units other than those of the columns are among rows."""
        columns = self.header.columns
        for found in _LETTERS.finditer(rows):
            text = found[0].decode("utf-8", "replace")
            cells = cells_of(text, self.separator)
            if len(cells) < NAMES or any(map(is_like_number, cells)):
                continue
            same = [cell.strip("()[]") for cell in cells] == [column.unit for column in columns]
            named = in_cells(cells)
            pairs = zip(named, columns, strict=False)
            agree = all(one.name in ("", other.name) for one, other in pairs)  # a cut last line
            if (all(measured(named).values()) and not agree) or (are_units(cells) and not same):
                raise InputError(
                    f"names or units other than those above begin here ('{text.strip()[:SHOWN]}')",
                    file=self.file,
                    line=first + rows.count(b"\n", 0, found.start()),
                    remedy="export each test to a file of its own",
                )


def _by_label(
    test: Recording, columns: Sequence[NamedColumn], labels: Sequence[Labels]
) -> list[Recording]:
    """Return a test for each stretch of rows with the same labels, or the test itself."""
    changes = [np.diff(one.codes) != 0 for one in labels]
    cuts = [0, *(np.flatnonzero(np.any(changes, axis=0)) + 1).tolist(), test.time.values.size]
    if not labels or not 2 < len(cuts) <= _MOST_TESTS + 1 or min(np.diff(cuts)) < LEAST:
        return [test]
    names = [column.name for column in columns]
    unused = tuple(name for name in test.unused if name not in names)
    words = [_LABEL.fullmatch(plain_name(name)) for name in names]
    specimens = [k for k, word in enumerate(words) if word and word["specimen"]]
    several = len(specimens) < len(columns)  # columns of specimens and of their tests
    of_pad = specimens[0] if several and specimens else None
    tests = []
    for begin, end in pairwise(cuts):
        row = [one.texts[one.codes[begin]] for one in labels]
        own = [test.name]
        for k, (name, text) in enumerate(zip(names, row, strict=True)):
            own += [] if k == of_pad else [f"{name} {text}" if text.isdigit() else text]
        part = test.changed(itemgetter(slice(begin, end)))
        stated = Stated() if of_pad is None else named_specimen(names[of_pad], row[of_pad])
        full, dropped = " ".join(own).strip(), {} if begin else test.dropped
        tests.append(replace(part, name=full, dropped=dropped, unused=unused, stated=stated))
    if not several or not starts_on_one_clock([one.time.values for one in tests]):
        return tests
    return [replace(one, stated=replace(one.stated, began=0.0, dated=_RUNS_ON)) for one in tests]


def _goes_on(
    before: Sequence[Recording], after: Sequence[Recording], file: Path, line: int
) -> bool:
    """Return whether a part below repeated names goes on with the tests of the part before.

    It does where time does. Where the clock begins anew although displacement and force go on under
    load, nobody knows how long the pause was: that is refused.
    """
    if len(before) != len(after):
        return False
    goes_on, loaded = True, True
    for old, new in zip(before, after, strict=True):
        way, load = old.way.values, old.load.values
        goes_on &= bool(new.time.values[0] >= old.time.values[-1])
        peak = float(np.abs(load).max())
        moved = abs(float(new.way.values[0] - way[-1])) > _SAME * float(np.ptp(way))
        fell = abs(float(new.load.values[0] - load[-1])) >= 2.0 * _SAME * peak
        loaded &= abs(float(load[-1])) >= _LOADED * peak > 0.0 and not moved and not fell
    if loaded and not goes_on:
        raise InputError(
            "the clock begins anew here, and displacement and force go on from the rows above",
            file=file,
            line=line,
            remedy="export the test with one clock, or each part to a file of its own if the "
            "specimen was unloaded between them",
        )
    return goes_on


def _together(before: Recording, after: Recording) -> Recording:
    """Return two parts of one test as one."""
    more = iter(channel.values for channel in after.channels)
    joint = before.changed(lambda values: np.append(values, next(more)))
    return replace(joint, dropped=dict(Counter(before.dropped) + Counter(after.dropped)))
