"""Read measurements, a study of pads each with its tests, from one tidy CSV file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import ClassVar, Literal, NoReturn, cast

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import as_typed, prints
from qlvbayes.io.files import folder_fault, same_folder
from qlvbayes.io.formats.answers import UnsureError
from qlvbayes.io.formats.catalogue import known_formats
from qlvbayes.io.formats.conversion import Conversion, convert
from qlvbayes.io.formats.layouts import TWO_CLOCKS
from qlvbayes.io.formats.recognition import head_of, matching, refuse_results, refuse_timeless
from qlvbayes.io.formats.textfile import Lines, content, decoded, is_text, with_tabs
from qlvbayes.io.formats.texttable import refuse_unknown_units
from qlvbayes.io.reading.badline import parse_number
from qlvbayes.io.reading.csvtext import digest, unchanged
from qlvbayes.io.reading.dialect import Dialect, sniff
from qlvbayes.io.reading.noreading import no_readings, out_of_range, same_readings
from qlvbayes.io.reading.table import Table, read_table
from qlvbayes.io.reading.testchecks import Checker, Rows
from qlvbayes.io.reading.unread import UNREAD, unread_rows
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import listed, of_lines

Role = Literal["fit", "validate"]


class Control(StrEnum):
    """The quantity that a testing machine prescribes; the other one responds."""

    DISPLACEMENT = "displacement"
    FORCE = "force"


_CONTROLS = {
    "displacement": Control.DISPLACEMENT,
    "strain": Control.DISPLACEMENT,
    "force": Control.FORCE,
    "stress": Control.FORCE,
}
_USED = {"1": True, "yes": True, "true": True, "0": False, "no": False, "false": False}


@dataclass(frozen=True)
class Prescribed:
    """The quantity that is prescribed in a test from ``start`` to ``stop`` (s)."""

    control: Control
    start: float
    stop: float


@dataclass(frozen=True, eq=False)
class Test:
    """A test of one pad: n samples of time, displacement and force.

    name: The test's name, unique within its pad; pad: The pad's name; time: (n,) in s, rising;
    displacement: (n,) displacement or strain, in the file's own unit (`Pad.units`); force: (n,)
    force or stress, in the file's own unit; force_sd: (n,) measured standard deviation of each
    force; None where it was not measured; role: ``fit`` or ``validate``; None where the file does
    not say; rate: Declared loading rate, displacement over s; None where none is declared; start_s:
    Time of the pad's clock at the first sample (s); start_known: Whether ``start_s`` was measured;
    otherwise the tests follow without a pause; control: Which quantity was prescribed in the whole
    test; None where the file does not say, or where it changes within the test; changes: Stretches
    of time, one after another, with the quantity prescribed in each, where the file says that it
    changes within the test; else empty; contact_sd: Standard error of the displacement's zero, in
    the unit of displacement; None where it was not measured; contact_stage: Name of the stage whose
    contact is the test's zero, where it shares that error with the pad's other tests of that name;
    empty where its error is its own; used: (n,) whether the force of each sample is used; None
    where all are. The displacement is the specimen's history and always is; anew: (n,) whether the
    displacement of each sample was read anew; None where all were.
    """

    __test__: ClassVar[bool] = False  # pytest must not collect it

    name: str
    pad: str
    time: Floats
    displacement: Floats
    force: Floats
    force_sd: Floats | None = None
    role: Role | None = None
    rate: float | None = None
    start_s: float = 0.0
    start_known: bool = False
    control: Control | None = None
    changes: tuple[Prescribed, ...] = ()
    contact_sd: float | None = None
    contact_stage: str = ""
    used: Mask | None = None
    anew: Mask | None = None

    @property
    def states_control(self) -> bool:
        """True if the file states the prescribed quantity."""
        return self.control is not None or bool(self.changes)


@dataclass(frozen=True, eq=False)
class Pad:
    """A pad and its tests, in the file's order.

    name: The pad's name; tests: Its tests; units: The units of its displacements and forces; fluid:
    What fills the pad; None where the file does not say.
    """

    name: str
    tests: tuple[Test, ...]
    units: UnitSystem
    fluid: str | None = None


@dataclass(frozen=True, eq=False)
class Measurements:
    """All pads of one file, with its path, its SHA-256 and notices about how it was read."""

    pads: tuple[Pad, ...]
    units: UnitSystem
    source: str
    sha256: str
    notices: tuple[str, ...]

    def pad(self, name: str) -> Pad:
        """Return the pad of that name; an InputError lists the known names otherwise."""
        for pad in self.pads:
            if pad.name == name:
                return pad
        known = listed([pad.name for pad in self.pads])
        raise InputError(f"no pad '{name}'", file=self.source, remedy=f"name one of: {known}")


def read_measurements(path: str | Path) -> Measurements:
    """Read a CSV or .csv.gz file that has a row per sample."""
    file = Path(path)
    with unchanged(file):
        try:
            dialect: Dialect | InputError = sniff(file)
        except InputError as error:
            dialect = error
        if (converted := _machine_file(file, dialect)) is not None:
            return measurements_of(converted, str(path), digest(file))
        if isinstance(dialect, InputError):
            raise dialect
        pads, left_out = _pads(file, dialect, read_table(file, dialect))
        sha256 = digest(file)
    return Measurements(
        pads, dialect.columns.units, str(path), sha256, (*_notices(dialect), *left_out)
    )


def measurements_of(conversion: Conversion, source: str, sha256: str) -> Measurements:
    """Return the tests of a conversion of machine files as measurements."""
    pads = _converted(conversion)
    return Measurements(pads, conversion.units, source, sha256, conversion.notices)


def _converted(conversion: Conversion) -> tuple[Pad, ...]:
    """Return the pads of a conversion; without a clock the tests of a pad follow one another."""
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
                control=Control.FORCE if tidied.prescribed_force else None,
            )
        )  # fmt: skip
    return tuple(Pad(name, tuple(of_pad), conversion.units) for name, of_pad in tests.items())


def _pads(file: Path, dialect: Dialect, table: Table) -> tuple[tuple[Pad, ...], tuple[str, ...]]:
    """Return the pads, each with its tests in order, and notices about rows left out."""
    builder = _Builder(file, dialect, table)
    notices: list[str] = []
    tests: dict[str, list[Test]] = {}
    fluids: dict[str, str | None] = {}
    for grouped in _grouped(table):
        rows, late = builder.read(grouped, notices)
        builder.check_folder(rows, tests)
        of_pad = tests.setdefault(rows.pad, [])
        of_pad.append(builder.test(rows, of_pad[-1] if of_pad else None, notices, late))
        builder.add_fluid(rows, fluids)
    units = dialect.columns.units
    pads = [Pad(name, tuple(of_pad), units, fluids[name]) for name, of_pad in tests.items()]
    return tuple(pads), tuple(notices)


def _notices(dialect: Dialect) -> tuple[str, ...]:
    notices = [dialect.notice] if dialect.notice else []
    twins = [c.name for key, c in dialect.columns.numeric.items() if key.endswith(" 2")]
    if ignored := (*dialect.columns.ignored, *twins):
        notices.append(f"columns not used: {', '.join(ignored)}")
    return tuple(notices)


def _grouped(table: Table) -> Iterator[Rows]:
    """Yield the tests in order of first appearance; rows of one name are one test."""
    runs = table.runs
    nothing = np.zeros(len(runs.starts) - 1, np.int64)
    pads, tests = runs.codes.get("pad", nothing), runs.codes.get("test", nothing)
    bounds = runs.starts.tolist()
    stretches: dict[tuple[int, int], list[slice]] = {}
    for n, key in enumerate(zip(pads.tolist(), tests.tolist(), strict=True)):
        stretches.setdefault(key, []).append(slice(bounds[n], bounds[n + 1]))
    pad_names = runs.texts.get("pad", ["pad"])
    test_names = runs.texts.get("test", ["test"])
    for (pad, test), parts in stretches.items():
        yield Rows(pad_names[pad], test_names[test], tuple(_joined(parts)))


def _joined(parts: list[slice]) -> Iterator[slice]:
    """Join stretches that touch, where only role, rate or start changed."""
    current = parts[0]
    for part in parts[1:]:
        if part.start == current.stop:
            current = slice(current.start, part.stop)
        else:
            yield current
            current = part
    yield current


@dataclass(frozen=True)
class _Builder:
    """Builder of the tests of a table."""

    file: Path
    dialect: Dialect
    table: Table

    def read(self, rows: Rows, notices: list[str]) -> tuple[Rows, float]:
        """Return the rows that were read, and by how much (s) they begin later than the test."""
        named = ("time", "displacement", "force")
        time, way, load = (rows.take(self.table.numeric[key]) for key in named)
        unread = unread_rows(time, way, load)
        if not unread:
            return rows, 0.0
        notices.append(
            f"test '{rows.test}' of pad '{rows.pad}': dropped {of_lines(unread, UNREAD)} "
            f"(line {self.table.line(rows.row(0))})"
        )
        return rows.after(unread), float(time[unread] - time[0])

    def test(self, rows: Rows, before: Test | None, notices: list[str], late: float = 0.0) -> Test:
        """Return one test; `before` is the pad's previous one."""
        self._names(rows)
        columns = {key: rows.take(column) for key, column in self.table.numeric.items()}
        self._twins(rows, columns)
        checker = Checker(self.file, self.table, self.dialect.columns)
        controls = self._controls(rows, columns["time"])
        used = self._used(rows, columns["time"].size)
        if not controls and self._creeps(columns):
            time = columns["time"]
            controls = (Prescribed(Control.FORCE, float(time[0]), float(time[-1])),)
            notices.append(
                f"test '{rows.test}' of pad '{rows.pad}': {self._name('force')} is "
                f"{columns['force'][0]:g} in every row: it is taken as prescribed, and the test as "
                "creep; a column control that says displacement or force states it"
            )
        self._readings(rows, columns, used)
        loaded = any(part.control == Control.FORCE for part in controls)
        checker.check(rows, columns, loaded=loaded, used=used)
        self._range(rows, columns, used)
        for values in columns.values():
            values.setflags(write=False)
        return Test(
            name=rows.test,
            pad=rows.pad,
            time=columns["time"],
            displacement=columns["displacement"],
            force=columns["force"],
            force_sd=columns.get("force_sd"),
            role=self._role(rows),
            rate=self._rate(rows),
            start_s=self._start(rows, before, late),
            start_known=self._number(rows, "start") is not None,
            control=controls[0].control if len(controls) == 1 else None,
            changes=controls if len(controls) > 1 else (),
            contact_sd=self._contact_sd(rows),
            contact_stage=self._label(rows, "contact_stage"),
            used=None if used.all() else used,
        )

    def _twins(self, rows: Rows, columns: dict[str, Floats]) -> None:
        """Refuse a quantity in two columns that differ by more than the digits of either."""
        for key in ("displacement", "force"):
            if (other := columns.pop(f"{key} 2", None)) is not None and not same_readings(
                columns[key], other, rounded=True
            ):
                both = f"'{self._name(key)}' and '{self._name(f'{key} 2')}'"
                self._fail(
                    rows, rows.row(0), f"two columns for {key}: {both}", "delete one of them"
                )

    @staticmethod
    def _creeps(columns: dict[str, Floats]) -> bool:
        """Return whether a force that is not zero never changes while the displacement does."""
        force = columns["force"]
        constant = bool(force[0] > 0.0 and (force == force[0]).all())
        return constant and bool((columns["displacement"] != columns["displacement"][0]).any())

    def _name(self, key: str) -> str:
        return self.dialect.columns.numeric[key].name

    def _readings(self, rows: Rows, columns: dict[str, Floats], used: Mask) -> None:
        """Refuse rows with a logger's code in place of a reading, as empty cells are refused."""
        for key, counts in (("displacement", np.ones_like(used)), ("force", used)):
            missing = no_readings(columns[key][counts])
            if missing.count:
                first = int(np.flatnonzero(counts)[np.argmax(missing.rows)])
                name = self.dialect.columns.numeric[key].name
                times = f"{missing.count} rows, the first" if missing.count > 1 else "one row,"
                what = f"{name} is {missing.written}, a code for no reading, in {times} at "
                what += f"{columns['time'][first]:.6g} s,"
                self._fail(rows, rows.row(first), what, "delete these rows")

    def _range(self, rows: Rows, columns: dict[str, Floats], used: Mask) -> None:
        headers = self.dialect.columns.numeric
        read = {"displacement": columns["displacement"], "force": columns["force"][used]}
        named = {headers[key].name: values for key, values in read.items()}
        if (what := out_of_range(columns["time"], named)) is not None:
            self._fail(rows, rows.row(0), f"{what}, which no rig measures,", "check the units")

    def add_fluid(self, rows: Rows, fluids: dict[str, str | None]) -> None:
        """Record the fluid of the test's pad, which must be that of the pad's other tests."""
        fluid = self._label(rows, "fluid") or None
        if fluid:
            self._names_folder(rows, "fluid", fluid)
        before = fluids.setdefault(rows.pad, fluid)
        if before != fluid:
            name = self.dialect.columns.labels["fluid"].name
            what = f"{name} changes from '{before or ''}' to '{fluid or ''}'"
            self._fail(rows, rows.row(0), what, f"write one {name} for all rows of a pad")

    def _fail(self, rows: Rows, row: int, message: str, remedy: str) -> NoReturn:
        line = self.table.line(row)
        where = f" in test '{rows.test}' of pad '{rows.pad}'"
        raise InputError(message + where, file=self.file, line=line, remedy=remedy)

    def _names(self, rows: Rows) -> None:
        first = rows.row(0)
        for key, name in (("pad", rows.pad), ("test", rows.test)):
            if not name:
                self._fail(rows, first, f"{key} is empty", "write its name")
        if not all(map(prints, rows.test)):
            what = f"the test's name '{rows.test}' has a character that does not print"
            self._fail(rows, first, what, "write it without")
        self._names_folder(rows, "pad", rows.pad)

    def _names_folder(self, rows: Rows, what: str, name: str) -> None:
        if (fault := folder_fault(name)) is not None:
            why, remedy = fault
            raise InputError(
                f"the {what}'s name '{name[:200]}' {why}",
                file=self.file,
                line=self.table.line(rows.row(0)),
                remedy=remedy,
            )

    def check_folder(self, rows: Rows, before: Iterable[str]) -> None:
        """Refuse a pad whose folder some disks would take for another pad's."""
        for name in before:
            if name != rows.pad and same_folder(name) == same_folder(rows.pad):
                what = f"the pads '{name}' and '{rows.pad}' differ in upper and lower case only"
                self._fail(rows, rows.row(0), what, "write one name, or two that differ in more")

    def _label(self, rows: Rows, key: str) -> str:
        """Return a label's text, the same in all rows of the test; empty without such a column."""
        (_, first), *others = self._labels(rows, key)
        if others:
            name = self.dialect.columns.labels[key].name
            sample, text = others[0]
            what = f"{name} changes from '{first}' to '{text}'"
            self._fail(rows, rows.row(sample), what, f"write one {name} for all its rows")
        return first

    def _labels(self, rows: Rows, key: str) -> list[tuple[int, str]]:
        """Return each text of a label with the first sample that has it, where it changes."""
        runs = self.table.runs
        if key not in runs.codes:
            return [(0, "")]
        changes: list[tuple[int, int]] = []
        sample = 0
        for stretch in rows.stretches:
            begin = int(np.searchsorted(runs.starts, stretch.start, side="right")) - 1
            end = int(np.searchsorted(runs.starts, stretch.stop))
            codes = runs.codes[key][begin:end]
            for n in np.flatnonzero(
                np.diff(codes, prepend=changes[-1][1] if changes else -1)
            ).tolist():
                offset = max(int(runs.starts[begin + n]) - stretch.start, 0)
                changes.append((sample + offset, int(codes[n])))
            sample += stretch.stop - stretch.start
        return [(at, runs.texts[key][code]) for at, code in changes]

    def _role(self, rows: Rows) -> Role | None:
        role = self._label(rows, "role")
        if role not in ("fit", "validate", ""):
            what = f"role '{role}' is unknown"
            self._fail(rows, rows.row(0), what, "write fit, validate or nothing")
        return cast(Role, role) if role else None

    def _controls(self, rows: Rows, time: Floats) -> tuple[Prescribed, ...]:
        """Return what was prescribed in each stretch of a test; nothing where no row says it."""
        labels = self._labels(rows, "control")
        if labels == [(0, "")]:
            return ()
        for sample, text in labels:
            if text not in _CONTROLS:
                what = f"control '{text}' is unknown" if text else "control is empty"
                remedy = "write displacement or force in all rows of the test, or nothing in all"
                self._fail(rows, rows.row(sample), what, remedy)
        ends = [float(0.5 * (time[k - 1] + time[k])) for k, _ in labels[1:]]
        bounds = [float(time[0]), *ends, float(time[-1])]
        controls = [_CONTROLS[text] for _, text in labels]
        return tuple(map(Prescribed, controls, bounds[:-1], bounds[1:]))

    def _used(self, rows: Rows, size: int) -> Mask:
        """Return which samples' force is used (n,): all of them where no row says it."""
        labels = self._labels(rows, "use")
        if labels == [(0, "")]:
            return np.ones(size, dtype=bool)
        for sample, text in labels:
            if text.lower() not in _USED:
                what = f"use '{text[:40]}' is neither 1 nor 0" if text else "use is empty"
                remedy = "write 1 (yes, true) or 0 (no, false) in all rows of the test, or nothing"
                self._fail(rows, rows.row(sample), what, f"{remedy} in all")
        lengths = np.diff([*(sample for sample, _ in labels), size])
        return np.repeat([_USED[text.lower()] for _, text in labels], lengths)

    def _number(self, rows: Rows, key: str) -> float | None:
        """Return the number declared for a test, or None where the cell is empty."""
        text = self._label(rows, key)
        if not text:
            return None
        value = parse_number(text, self.dialect.decimal)
        column = self.dialect.columns.labels[key]
        if value is None or not math.isfinite(value):
            what = f"{column.name} is not a number ('{text[:40]}')"
            self._fail(rows, rows.row(0), what, "write a number or leave it empty")
        return value * column.scale.up / column.scale.down

    def _rate(self, rows: Rows) -> float | None:
        rate = self._number(rows, "rate")
        if rate is not None and rate <= 0:
            name = self.dialect.columns.labels["rate"].name
            what = f"{name} is not positive ({rate:g})"
            self._fail(rows, rows.row(0), what, "write the speed of loading without sign")
        return rate

    def _contact_sd(self, rows: Rows) -> float | None:
        sd = self._number(rows, "contact_sd")
        if sd is not None and sd < 0:
            name = self.dialect.columns.labels["contact_sd"].name
            what = f"{name} is negative ({sd:g})"
            self._fail(rows, rows.row(0), what, "write its standard error or leave it empty")
        return sd or None

    def _start(self, rows: Rows, before: Test | None, late: float) -> float:
        """Return the declared start, or the end of the pad's previous test."""
        start = self._number(rows, "start")
        if start is not None:
            return start + late
        if before is None:
            return 0.0
        return before.start_s + float(before.time[-1] - before.time[0])


def _machine_file(file: Path, tidy: Dialect | InputError) -> Conversion | None:
    """Return the tests of a machine's file, or None where the file is none."""
    if isinstance(tidy, Dialect) and not tidy.columns.ignored:
        return None
    try:
        head = head_of(file)
    except InputError:
        return None
    whole, _, _ = matching(head, (TWO_CLOCKS,) if isinstance(tidy, Dialect) else known_formats())
    if len(whole) != 1:
        if isinstance(tidy, InputError) and is_text(head):
            refuse_results(head, file)
            refuse_unknown_units(Lines.from_bytes(decoded(head).encode()), file)
            refuse_timeless(with_tabs(content(file))[0], file)
        return None
    try:
        return convert([file])
    except UnsureError as error:
        again = as_typed("qlvbayes", "look", str(file), "-o", "tidy.csv")
        raise error.elsewhere(again) from error
