"""Read measurements, a study of pads each with its tests, from one tidy CSV file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NoReturn, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError
from qlvbayes.io.contact import is_driven_back
from qlvbayes.io.conversion import Conversion, convert
from qlvbayes.io.files import folder_fault, same_folder
from qlvbayes.io.formats import known_formats, matching, refuse_by_content
from qlvbayes.io.layouts import TWO_CLOCKS
from qlvbayes.io.readings import (
    LEAST_SAMPLES,
    no_readings,
    out_of_range,
    same_readings,
    slipped,
    starts_on_one_clock,
    unread_rows,
    wrong_signs,
)
from qlvbayes.io.recording import (
    Control,
    Measurements,
    Pad,
    Prescribed,
    Role,
    Test,
    UnsureError,
)
from qlvbayes.io.table import Labels, RowForm, Rows, parse_number, read_rows
from qlvbayes.io.text import content, digest, head_of, is_text
from qlvbayes.io.tidy import Dialect, sniff
from qlvbayes.io.wording import as_typed, joined, of_lines, prints

Meaning = TypeVar("Meaning")
_CONTROLS = {
    "displacement": Control.DISPLACEMENT,
    "strain": Control.DISPLACEMENT,
    "force": Control.FORCE,
    "stress": Control.FORCE,
}
_USED = {"1": True, "yes": True, "true": True, "0": False, "no": False, "false": False}


def read_measurements(path: str | Path) -> Measurements:
    """Read a tidy CSV or .csv.gz file that has a row per sample, or a machine's file."""
    file = Path(path)
    sha256 = digest(file)
    try:
        dialect: Dialect | InputError = sniff(file)
    except InputError as error:
        dialect = error
    if (converted := _machine_file(file, dialect)) is not None:
        return measurements_of(converted, str(path), sha256)
    if isinstance(dialect, InputError):
        raise dialect
    pads, left_out = _pads(file, dialect, read_tidy(file, dialect))
    if digest(file) != sha256:
        remedy = "wait until it is written and try again"
        raise InputError("the file changed while it was read", file=file, remedy=remedy)
    notices = [dialect.notice] if dialect.notice else []
    if dialect.ignored:
        notices.append(f"columns not used: {', '.join(dialect.ignored)}")
    return Measurements(pads, dialect.units, str(path), sha256, (*notices, *left_out))


def read_tidy(file: Path, dialect: Dialect) -> Rows:
    """Return the rows of a tidy file, its numbers in the units of the dialect."""
    numbers = [(column.index, column.name) for column in dialect.numeric.values()]
    labels = [column.index for column in dialect.labels.values()]
    form = RowForm(dialect.separator, numbers, labels, len(dialect.names), dialect.decimal)
    rows = content(file).split(b"\n", dialect.line)[-1]
    read = read_rows(rows, form, file, dialect.line + 1)
    for column, values in zip(dialect.numeric.values(), read.columns, strict=True):
        column.scale.convert(values)
    return read


def _machine_file(file: Path, tidy: Dialect | InputError) -> Conversion | None:
    """Return the tests of a machine's file, or None where the file is none."""
    if isinstance(tidy, Dialect) and not tidy.ignored:
        return None
    refused = isinstance(tidy, InputError)
    head = head_of(file)
    try:
        if len(matching(head, known_formats() if refused else (TWO_CLOCKS,))) == 1:
            return convert([file])
        if refused and is_text(head):
            refuse_by_content(head, file)
        return None
    except UnsureError as error:
        again = as_typed("qlvbayes", "look", str(file), "-o", "tidy.csv")
        raise error.elsewhere(again) from error


def measurements_of(conversion: Conversion, source: str, sha256: str) -> Measurements:
    """Return the tests of a conversion; without a clock they follow one another."""
    tests: dict[str, list[Test]] = {}
    for tidied in conversion.tests:
        of_pad = tests.setdefault(tidied.pad, [])
        start = tidied.start_s
        if start is None:
            start = of_pad[-1].start_s + float(of_pad[-1].time[-1]) if of_pad else 0.0
        for values in (tidied.time, tidied.displacement, tidied.force):
            values.setflags(write=False)
        of_pad.append(
            Test(
                tidied.test, tidied.pad, tidied.time, tidied.displacement, tidied.force,
                start_s=start, start_known=tidied.start_s is not None,
                contact_sd=tidied.zero_sd, contact_stage=tidied.contact_stage,
                tare_sd=tidied.tare_sd,
                control=Control.FORCE if tidied.prescribed_force else None,
            )
        )  # fmt: skip
    pads = tuple(Pad(name, tuple(of_pad), conversion.units) for name, of_pad in tests.items())
    return Measurements(pads, conversion.units, source, sha256, conversion.notices)


def _pads(file: Path, dialect: Dialect, rows: Rows) -> tuple[tuple[Pad, ...], tuple[str, ...]]:
    """Return the pads, each with its tests in order, and notices about rows left out."""
    notices: list[str] = []
    tests: dict[str, list[Test]] = {}
    fluids: dict[str, str | None] = {}
    labels = dict(zip(dialect.labels, rows.labels, strict=True))
    one = Labels(np.zeros(len(rows.columns[0]), np.intp), [])
    of_pads, of_tests = labels.get("pad", one), labels.get("test", one)
    keys = of_pads.codes * (len(of_tests.texts) + 1) + of_tests.codes
    cuts = [0, *(np.flatnonzero(np.diff(keys)) + 1).tolist()]
    stretches: dict[int, list[slice]] = {}  # of each test, in order of first appearance
    for begin, end in pairwise([*cuts, len(keys)]):
        stretches.setdefault(int(keys[begin]), []).append(slice(begin, end))
    for key, (first, *others) in stretches.items():
        pad, test = (
            own.texts[own.codes[first.start]] if own.texts else name
            for own, name in ((of_pads, "pad"), (of_tests, "test"))
        )
        indices = np.flatnonzero(keys == key) if others else first
        built = _Builder(file, dialect, rows, labels, pad, test, indices, notices)
        built.check_names(tests)
        of_pad = tests.setdefault(pad, [])
        of_pad.append(built.test(of_pad[-1] if of_pad else None))
        fluid = built.label("fluid") or None
        if fluid:
            built.check_folder("fluid", fluid)
        if fluids.setdefault(pad, fluid) != fluid:
            name = dialect.labels["fluid"].name
            what = f"{name} changes from '{fluids[pad] or ''}' to '{fluid or ''}'"
            built.fail(0, what, f"write one {name} for all rows of a pad")
    for pad, of_pad in tests.items():  # their times may run on from test to test
        starts = starts_on_one_clock([test.time for test in of_pad])
        if starts is not None and not any(test.start_known for test in of_pad):
            tests[pad] = [
                replace(one, start_s=at, start_known=True)
                for one, at in zip(of_pad, starts, strict=True)
            ]
    pads = tuple(Pad(name, tuple(own), dialect.units, fluids[name]) for name, own in tests.items())
    return pads, tuple(notices)


@dataclass(frozen=True, eq=False)
class _Builder:
    """Builder of one test: its rows in the table, and the names of pad and test."""

    file: Path
    dialect: Dialect
    table: Rows
    labels: dict[str, Labels]
    pad: str
    name: str
    rows: slice | NDArray[np.intp]
    notices: list[str]
    late: float = 0.0  # s, by which the rows begin later than the test

    @property
    def title(self) -> str:
        """Return the test as text."""
        return f"test '{self.name}' of pad '{self.pad}'"

    def fail(self, sample: int, message: str, remedy: str, *, alone: bool = False) -> NoReturn:
        """Raise the error at a sample of the test, which the text names unless it is ``alone``."""
        where = "" if alone else f" in {self.title}"
        rows = self.rows
        row = rows.start + sample if isinstance(rows, slice) else rows[sample]
        raise InputError(message + where, file=self.file, line=self.table.line(row), remedy=remedy)

    def check_names(self, before: Iterable[str]) -> None:
        """Refuse names that are empty, or that no folder can have beside those of other pads."""
        for key, name in (("pad", self.pad), ("test", self.name)):
            if not name:
                self.fail(0, f"{key} is empty", "write its name")
        if not all(map(prints, self.name)):
            what = f"the test's name '{self.name}' has a character that does not print"
            self.fail(0, what, "write it without")
        self.check_folder("pad", self.pad)
        for other in before:
            if other != self.pad and same_folder(other) == same_folder(self.pad):
                what = f"the pads '{other}' and '{self.pad}' differ in upper and lower case only"
                self.fail(0, what, "write one name, or two that differ in more")

    def check_folder(self, what: str, name: str) -> None:
        """Refuse a name that no folder of results can have."""
        if (fault := folder_fault(name)) is not None:
            self.fail(0, f"the {what}'s name '{name[:200]}' {fault[0]}", fault[1], alone=True)

    def test(self, before: Test | None) -> Test:
        """Return the test; ``before`` is the pad's previous one."""
        columns = {
            key: column[self.rows]
            for key, column in zip(self.dialect.numeric, self.table.columns, strict=True)
        }
        names = {key: column.name for key, column in self.dialect.numeric.items()}
        for key in ("displacement", "force"):  # a quantity's column in another unit
            other = columns.pop(f"{key} 2", None)
            if other is not None and not same_readings(columns[key], other):
                both = f"'{names[key]}' and '{names[f'{key} 2']}'"
                self.fail(0, f"two columns for {key}: {both}", "delete one of them", alone=True)
        time, way, force = (columns[key] for key in ("time", "displacement", "force"))
        if unread := unread_rows(time, way, force):
            lost = of_lines(unread, "rows before the channels were read, both exactly 0")
            self.notices.append(f"{self.title}: dropped {lost}")
            rows = np.arange(len(self.table.columns[0]))[self.rows][unread:]
            return replace(self, rows=rows, late=float(time[unread] - time[0])).test(before)
        controls = self._stretches("control", _CONTROLS)
        rests = force[0] > 0.0 and np.ptp(force) == 0.0 < np.ptp(way)
        if not controls and rests and not is_driven_back(way):
            controls = [(0, Control.FORCE)]
            self.notices.append(
                f"{self.title}: {names['force']} is {force[0]:g} in every row: it is taken as "
                "prescribed, and the test as creep; a column control that says displacement or "
                "force states it"
            )
        kept = self._stretches("use", _USED)
        lengths = np.diff([*(sample for sample, _ in kept), time.size])
        used = np.repeat([one for _, one in kept], lengths) if kept else np.ones(time.size, bool)
        self._check(columns, names, used, loaded=any(one == Control.FORCE for _, one in controls))
        for values in columns.values():
            values.setflags(write=False)
        start = self._number("start")
        follows = 0.0 if before is None else before.start_s + float(np.ptp(before.time))
        bounds = [float(0.5 * (time[k - 1] + time[k])) for k, _ in controls[1:]]
        bounds = [float(time[0]), *bounds, float(time[-1])]
        changes = map(Prescribed, (one for _, one in controls), bounds[:-1], bounds[1:])
        role = self.label("role")
        if role not in ("fit", "validate", ""):
            self.fail(0, f"role '{role}' is unknown", "write fit, validate or nothing")
        return Test(
            name=self.name,
            pad=self.pad,
            time=time,
            displacement=way,
            force=force,
            force_sd=columns.get("force_sd"),
            role=cast(Role, role) if role else None,
            rate=self._number("rate", 0.0),
            start_s=follows if start is None else start + self.late,
            start_known=start is not None,
            control=controls[0][1] if len(controls) == 1 else None,
            changes=tuple(changes) if len(controls) > 1 else (),
            contact_sd=self._number("contact_sd", -1e-300) or None,
            contact_stage=self.label("contact_stage"),
            tare_sd=self._number("tare_sd", -1e-300) or 0.0,
            used=None if used.all() else used,
        )

    def _check(
        self, columns: dict[str, Floats], names: dict[str, str], used: Mask, *, loaded: bool
    ) -> None:
        """Raise InputError unless the test can be used."""
        time, way, force = (columns[key] for key in ("time", "displacement", "force"))
        for key, counts in (("displacement", np.ones_like(used)), ("force", used)):
            lost, codes = no_readings(columns[key][counts])
            if count := np.count_nonzero(lost):
                first = int(np.flatnonzero(counts)[np.argmax(lost)])
                what = f"{names[key]} is {codes}, a code for no reading, in "
                what += "one row," if count == 1 else f"{count} rows, the first"
                what += f" at {time[first]:.6g} s,"
                self.fail(first, what, "delete these rows")
        if slipped(time) is None:
            self._refuse_time(time)
        of_file = time.size, "", "add the missing rows"
        kept = np.count_nonzero(used), " to use", "write 1 in more rows of the column use"
        for size, by, remedy in (of_file, kept):
            if size < LEAST_SAMPLES:
                what = f"{self.title} has {size} rows{by}, at least {LEAST_SAMPLES} are needed"
                self.fail(0, what, f"{remedy} or delete the test", alone=True)
        for key, values in (("displacement", way), ("force", force[used])):
            held = key == "force" and loaded and values.max() > 0.0
            if values.min() == values.max() and not held:
                remedy = "check the channel or delete the test"
                self.fail(0, f"{names[key]} never changes", remedy)
        if "force_sd" in columns and columns["force_sd"].min() <= 0:
            bad = int(np.argmax(columns["force_sd"] <= 0))
            what = f"{names['force_sd']} is not positive ({columns['force_sd'][bad]:g})"
            self.fail(bad, what, "write its standard deviation or delete the column", alone=True)
        wrong = wrong_signs(way[used], force[used])
        if wrong and not (self.dialect.units.dimensionless and len(wrong) > 1):
            wrong_ones = " and ".join(names[key] for key in wrong)
            what = f"in {self.title} the specimen is loaded with {wrong_ones} of the wrong sign"
            self.fail(0, what, f"multiply {wrong_ones} by -1", alone=True)
        read = {names["displacement"]: way, names["force"]: force[used]}
        if (fault := out_of_range(time, read)) is not None:
            self.fail(0, f"{fault}, which no rig measures,", "check the units")

    def _refuse_time(self, time: Floats) -> NoReturn:
        """Refuse time that does not increase, and say how it fails."""
        index = int(np.argmax(time[1:] <= time[:-1])) + 1
        before, now = float(time[index - 1]), float(time[index])
        what, remedy = "restarts", "give each test its own name"
        if "test" not in self.labels:
            remedy = "add a test column naming each test"
        if now == before:
            what, remedy = "repeats", "write time with more decimals or delete the repeated row"
        elif now - time[0] > 0.1 * (before - time[0]):
            what, remedy = "runs backwards", "sort the test's rows by time"
        name = self.dialect.numeric["time"].name
        what = f"{name} {what} in {self.title} ({now:.9g} s after {before:.9g} s)"
        self.fail(index, what, remedy, alone=True)

    def label(self, key: str) -> str:
        """Return a label's text, the same in all rows of the test; empty without such a column."""
        (_, first), *others = self._labels(key)
        if others:
            name = self.dialect.labels[key].name
            what = f"{name} changes from '{first}' to '{others[0][1]}'"
            self.fail(others[0][0], what, f"write one {name} for all its rows")
        return first

    def _labels(self, key: str) -> list[tuple[int, str]]:
        """Return each text of a label with the first sample that has it, where it changes."""
        if key not in self.labels:
            return [(0, "")]
        codes = self.labels[key].codes[self.rows]
        starts = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist()]
        return [(at, self.labels[key].texts[codes[at]]) for at in starts]

    def _stretches(self, key: str, known: Mapping[str, Meaning]) -> list[tuple[int, Meaning]]:
        """Return what a label means from which sample on; nothing where no row says it."""
        labels = self._labels(key)
        if labels == [(0, "")]:
            return []
        for sample, text in labels:
            if text.lower() not in known:
                what = f"{key} '{text[:40]}' is unknown" if text else f"{key} is empty"
                remedy = f"write {joined(list(known), 'or')} in all rows of the test, or nothing"
                self.fail(sample, what, remedy)
        return [(sample, known[text.lower()]) for sample, text in labels]

    def _number(self, key: str, above: float = -math.inf) -> float | None:
        """Return the number declared for a test, or None where the cell is empty."""
        if not (text := self.label(key)):
            return None
        value = parse_number(text, self.dialect.decimal)
        column = self.dialect.labels[key]
        if value is None or not math.isfinite(value) or value <= above:
            what = "is not a number"
            if value is not None and value <= above:
                what = "is not positive" if above == 0.0 else "is negative"
            message = f"{column.name} {what} ('{text[:40]}')"
            self.fail(0, message, "write a number or leave it empty")
        return value * column.scale.up / column.scale.down
