"""Convert machine files to tidy tests: units, signs, contact, order, with all findings as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import SIGNS, Answers, UnsureError
from qlvbayes.io.formats.catalogue import FORMATS
from qlvbayes.io.formats.columns import NamedColumn, refuse_unknown_unit
from qlvbayes.io.formats.contact import FirstContact, Signs, find_contact, find_signs, is_dead
from qlvbayes.io.formats.format import AbstractFormat, Channel, Floats, Recording
from qlvbayes.io.formats.machineunits import QUANTITIES, Unit, unit_of
from qlvbayes.io.formats.naming import is_mean, pad_in, pads_of, pads_of_tests, tests_of
from qlvbayes.io.formats.recognition import recognised
from qlvbayes.io.formats.sampling import ClockError, Sampling, on_one_clock, rising, sampling_of
from qlvbayes.io.formats.stated_columns import stated_columns
from qlvbayes.io.formats.zero import OrientedRecording, Zero, zeros
from qlvbayes.io.reading.noreading import no_readings, out_of_range
from qlvbayes.io.reading.testchecks import LEAST_SAMPLES, wrong_signs
from qlvbayes.io.reading.unread import UNREAD, unread_rows
from qlvbayes.io.units import STRAIN, UnitSystem, unit_system
from qlvbayes.io.wording import joined, listed, of_lines, plain

LEAD = 1.0  # s kept before contact, which show the force's zero and its noise


@dataclass(frozen=True, eq=False)
class Tidied:
    """A test in tidy form, and the findings of the conversion, each with its numbers.

    ``time`` (s) begins at zero; ``displacement`` and ``force`` are in ``units``, and pressing is
    positive. ``named`` is the test's name in the file. ``start_s`` is the pad's clock at the first
    row, where the files state it. ``contact`` is the contact that the rise of the force shows, in
    the file's own zero; ``zero`` was subtracted from the displacement, and ``zero_sd`` is its
    standard error, where it was measured. Tests of one ``contact_stage`` share that error.
    """

    file: Path
    format: type[AbstractFormat]
    pad: str
    test: str
    named: str
    units: UnitSystem
    time: Floats
    displacement: Floats
    force: Floats
    start_s: float | None
    signs: Signs
    contact: FirstContact | None
    zero: float
    zero_sd: float | None
    contact_stage: str
    sampling: Sampling
    dropped: dict[str, int]
    findings: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Return the conversion of this test as a dictionary for JSON."""
        contact = None
        if self.contact is not None:
            contact = {"place": self.contact.position, "sd": self.contact.sd}
        return {
            "file": str(self.file),
            "format": self.format.name,
            "pad": self.pad,
            "test": self.test,
            "units": asdict(self.units),
            "turned": {"displacement": self.signs.way < 0, "force": self.signs.load < 0},
            "contact": contact,
            "zero": self.zero,
            "zero_sd": self.zero_sd,
            "contact_stage": self.contact_stage or None,
            "rows": len(self.time),
            "step_s": self.sampling.step,
            "lag_s": self.sampling.lag,
            "start_s": self.start_s,
            "dropped": self.dropped,
            "findings": list(self.findings),
        }


@dataclass(frozen=True, eq=False)
class Conversion:
    """All tests of some files, converted to one system of units.

    ``faults`` are the errors of files that could not be used; ``undivided`` is whether tests of
    one file are taken as those of one pad, although nobody has stated it.
    """

    tests: tuple[Tidied, ...]
    units: UnitSystem
    faults: tuple[InputError, ...] = ()
    undivided: bool = False

    @property
    def remarks(self) -> tuple[str, ...]:
        """Return what concerns all tests together: several of one file may be several specimens."""
        if not self.undivided:
            return ()
        names = ", ".join(test.test for test in _together(self.tests)[:6])
        return (
            f"the tests of one file are taken as those of one pad ({names}): if they are several "
            "specimens, --pad-from REGEX of convert finds the pads' names in the tests', or --pad "
            "names the pad of each test",
        )

    @property
    def notices(self) -> tuple[str, ...]:
        """Return all findings, a line each."""
        return (*(line for test in self.tests for line in findings_of(test)), *self.remarks)


def findings_of(test: Tidied) -> list[str]:
    """Return the findings of a test, as lines that begin with its name."""
    dropped = [f"dropped: {of_lines(rows, why)}" for why, rows in test.dropped.items()]
    same = test.file.stem == test.test  # then the name stands before the colon already
    source = f"read as {test.format.machine}"
    first = source if same else f"{test.file.name} {source}"
    return [f"{test.test}: {line}" for line in (first, *test.findings, *dropped)]


def in_short(notices: Sequence[str]) -> list[str]:
    """Return lines ``test: what`` for a terminal: what several tests share stands once."""
    lines: dict[str, list[str]] = {}
    for line in notices:
        lines.setdefault(line.partition(": ")[2] or line, []).append(line)
    return [
        same[0] if len(same) == 1 else f"{len(same)} tests: {what}" for what, same in lines.items()
    ]


def convert(
    files: Sequence[Path],
    answers: Answers = Answers(),  # noqa: B008 (frozen)
    kinds: Sequence[type[AbstractFormat]] = FORMATS,
    *,
    without_faulty: bool = False,
) -> Conversion:
    """Read machine files and convert them to tidy tests."""
    if answers.columns is not None:
        kinds = (stated_columns(answers.columns),)
    pads = pads_of(files, answers.pads)  # None: one a test
    faults: dict[Path, InputError] = {}
    read: list[_Prepared] = []
    for file, pad in zip(files, pads or [""] * len(files), strict=True):
        try:
            kind = recognised(file, kinds)
            read += _usable_tests(file, kind, _read(file, kind), pad, answers)
        except InputError as error:
            faults[file] = error
    one_by_one = pads is None or bool(answers.tests)  # no test may be left out of those named
    if pads is None and not faults:
        own = pads_of_tests([read_one.named for read_one in read], files, answers.pads)
        read = [read_one.of(pad) for read_one, pad in zip(read, own, strict=True)]
    starts = zeros([read_one.shown for read_one in read], answers)
    for read_one, zero in zip(read, starts, strict=True):
        if isinstance(zero, UnsureError):
            faults.setdefault(read_one.file, zero)
    if faults and (not without_faulty or len(faults) == len(set(files)) or one_by_one):
        raise next(faults[file] for file in files if file in faults)
    stages = [
        _stage(read_one, zero)
        for read_one, zero in zip(read, starts, strict=True)
        if read_one.file not in faults and isinstance(zero, Zero)
    ]
    if not stages:
        raise InputError("no test can be used", file=files[0], remedy="look at the file")
    named = [(stage.pad, stage.recording.name, stage.file) for stage in stages]
    names = tests_of(named, answers.tests)
    units = stages[0].units
    tests = [
        stage.tidied(name, units, clock)
        for stage, name, clock in zip(stages, names, _clocks(stages), strict=True)
    ]
    pads_stated = bool(answers.pads) or answers.pad_from is not None
    undivided = not pads_stated and bool(_together(tests))
    return Conversion(tuple(tests), units, tuple(faults.values()), undivided)


def _together(tests: Sequence[Tidied]) -> list[Tidied]:
    """Return the tests of files that hold several."""
    in_file = Counter(test.file for test in tests)
    return [test for test in tests if in_file[test.file] > 1]


def _read(file: Path, kind: type[AbstractFormat]) -> tuple[Recording, ...]:
    """Return the recordings of a file; an error of a format's code becomes an InputError."""
    try:
        return kind.read(file)
    except InputError:
        raise
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(
            f"the file cannot be read as {kind.name} ({text})",
            file=file,
            remedy="export it again",
        ) from error


@dataclass(frozen=True, eq=False)
class _Prepared:
    """Recording under conversion: columns in tidy units, in order, with the right signs."""

    file: Path
    kind: type[AbstractFormat]
    pad: str
    recording: Recording
    time: Floats
    shown: OrientedRecording
    sampling: Sampling
    dropped: dict[str, int]
    findings: tuple[str, ...]  # on the units, other columns and the signs

    @property
    def named(self) -> str:
        """Return the test's name in the file, or the file's."""
        return _name_in(self.file, self.recording)

    def of(self, pad: str) -> _Prepared:
        """Return the same recording as one of this pad."""
        stage = (pad, *self.shown.stage[1:])
        return replace(self, pad=pad, shown=replace(self.shown, stage=stage))


@dataclass(frozen=True, eq=False)
class _Stage:
    """Recording under conversion, with its zero."""

    file: Path
    kind: type[AbstractFormat]
    pad: str
    recording: Recording
    units: UnitSystem
    time: Floats
    way: Floats
    load: Floats
    signs: Signs
    zero: Zero
    sampling: Sampling
    dropped: dict[str, int]
    findings: tuple[str, ...]
    first: float  # time of the first row kept, on the file's clock (s)

    @property
    def began(self) -> float | None:
        """Return the date of the first row that is kept (s since 1970)."""
        return None if self.recording.began is None else self.recording.began + self.first

    def tidied(self, name: str, units: UnitSystem, start: float | None) -> Tidied:
        """Return the test with its name, in the units of all tests."""
        if units.dimensionless != self.units.dimensionless:
            raise InputError(
                "this file has strain and stress and others have displacement and force",
                file=self.file,
                remedy="convert them one by one",
            )
        way = (
            self.way * self.units.factor_to(units, "displacement")
            if units != self.units
            else self.way
        )
        load = (
            self.load * self.units.factor_to(units, "force") if units != self.units else self.load
        )
        sd = self.zero.sd
        if sd is not None:
            sd *= self.units.factor_to(units, "displacement")
        return Tidied(
            self.file, self.kind, self.pad, name, _name_in(self.file, self.recording), units,
            self.time, way, load, start, self.signs, self.zero.contact, self.zero.position, sd,
            self.zero.stage, self.sampling, self.dropped, self.findings,
        )  # fmt: skip


def _name_in(file: Path, recording: Recording) -> str:
    return recording.name or file.stem


class _DeadForceError(InputError):
    """Exception for a test in which the force does not answer to the displacement."""


def _usable_tests(
    file: Path,
    kind: type[AbstractFormat],
    recordings: Sequence[Recording],
    pad: str,
    answers: Answers,
) -> list[_Prepared]:
    """Return the usable tests of a file; parts without contact are left out where others are."""
    recordings, dropped = _without_means(recordings)
    recordings = [_without_missing(recording) for recording in recordings]
    moving = [recording for recording in recordings if not _is_still(recording)]
    still = sum(len(recording.time.values) for recording in recordings if _is_still(recording))
    if still:
        dropped["rows of parts in which nothing moves"] = still
    if not moving:
        raise InputError(
            f"no test of {LEAST_SAMPLES} rows or more in which displacement and force change"
            + _left_out(recordings),
            file=file,
            remedy="check the channels or export it again",
        )
    prepared: list[_Prepared] = []
    dead: list[InputError] = []
    for recording in moving:
        own = pad
        if answers.pad_from is not None:
            own = pad_in(_name_in(file, recording), answers.pad_from)
        try:
            prepared.append(_in_order(file, kind, recording, own, answers))
        except _DeadForceError as error:
            dropped[_dead_rows(recording)] = len(recording.time.values)
            dead.append(error)
    if not prepared:
        raise dead[0]
    live = [one for one in prepared if not is_dead(one.shown.way, one.shown.load)]
    if live:
        lost = [one.recording for one in prepared if one not in live]
        dropped |= {_dead_rows(one): len(one.time.values) for one in lost}
    kept = live or prepared
    kept[0].dropped.update(dropped)
    return kept


def _dead_rows(recording: Recording) -> str:
    return f"rows of '{recording.name}', in which the force does not answer"


def _without_means(recordings: Sequence[Recording]) -> tuple[list[Recording], dict[str, int]]:
    """Return the recordings without means of specimens, if there are others."""
    means = [recording for recording in recordings if is_mean(recording.name)]
    if len(means) in (0, len(recordings)):
        return list(recordings), {}
    kept = [recording for recording in recordings if not is_mean(recording.name)]
    return kept, {f"rows of the mean specimen '{m.name}'": len(m.time.values) for m in means}


def _left_out(recordings: Sequence[Recording]) -> str:
    """Return a note on rows that are no measurements: ' (9 rows with no number in Force ...)'."""
    counted = [
        of_lines(rows, why) for one in recordings for why, rows in one.dropped.items() if rows
    ]
    return f" ({', '.join(counted[:3])} are left out)" if counted else ""


def _without_missing(recording: Recording) -> Recording:
    """Return the recording without rows in which a channel has no number or a code."""
    channels = [recording.time, recording.way, recording.load]
    missing = [
        no_readings(channel.values, coded=channel is not recording.time) for channel in channels
    ]
    lost = np.logical_or.reduce([one.rows for one in missing])
    if not lost.any():
        return recording
    dropped = dict(recording.dropped)
    for channel, one in zip(channels, missing, strict=True):
        if one.count:
            what = f"a code for no reading ({one.written})" if one.codes else "no number"
            dropped[f"rows with {what} in {channel.name}"] = one.count
    kept = {
        part: replace(channel, values=channel.values[~lost])
        for part in ("time", "way", "load", "load_time")
        if (channel := getattr(recording, part)) is not None
    }
    return replace(recording, dropped=dropped, **kept)


def _is_still(recording: Recording) -> bool:
    columns = (recording.way.values, recording.load.values)
    return len(recording.time.values) < LEAST_SAMPLES or any(
        np.ptp(column) == 0.0 for column in columns
    )


def _in_order(
    file: Path, kind: type[AbstractFormat], recording: Recording, pad: str, answers: Answers
) -> _Prepared:
    if answers.units is None:
        named = (recording.time, recording.way, recording.load)
        refuse_unknown_unit([NamedColumn(k, c.name, c.unit) for k, c in enumerate(named)], file)
    units, columns, unit_finding = _in_units(file, recording, answers)
    dropped = dict(recording.dropped)
    time, way, load, sampling = _on_a_clock(file, columns, dropped)
    if unread := unread_rows(time, way, load):
        dropped[UNREAD] = unread
        time, way, load = time[unread:], way[unread:], load[unread:]
        sampling = sampling_of(time, sampling.lag)
    if (
        what := out_of_range(time, {recording.way.name: way, recording.load.name: load})
    ) is not None:
        raise InputError(f"{what}, which no rig measures", file=file, remedy="check the units")
    signs = _signs(file, way, load, recording, answers)
    way, load = way * signs.way, load * signs.load
    wrong = wrong_signs(way, load)
    if wrong and not (units.dimensionless and len(wrong) > 1):
        what = f"the specimen is pressed with {joined([*wrong])} negative"
        if answers.sign is None:
            raise _unsure_of_sign(file, what)
        remedy = "leave --sign out"
        raise InputError(f"with --sign {answers.sign} {what}", file=file, remedy=remedy)
    contact = None if units.dimensionless else find_contact(way, load)
    stage = (pad, kind.name, units, signs.way)
    shown = OrientedRecording(file, stage, units, time, way, load, signs, contact)
    unused = [f"columns not used: {listed(recording.unused)}"] if recording.unused else []
    findings = f"units {unit_finding}", *unused, _sign_finding(signs, recording, answers)
    return _Prepared(file, kind, pad, recording, time, shown, sampling, dropped, findings)


def _stage(read: _Prepared, zero: Zero) -> _Stage:
    """Return the recording with its zero, and without the rows long before contact."""
    time, dropped, contact = read.time, read.dropped, zero.contact
    own = contact is read.shown.contact
    first = 0 if contact is None or not own else int(
        np.searchsorted(time, time[contact.rows] - LEAD)
    )  # fmt: skip
    if len(time) - first < LEAST_SAMPLES:
        remedy = "export the whole test"
        raise InputError(f"only {len(time) - first} rows are left", file=read.file, remedy=remedy)
    if first:
        dropped[f"rows of the approach, more than {LEAD:g} s before contact"] = first
    sampled = read.sampling.describe() + _clocks_finding(read.recording, read.sampling)
    begin = float(time[first])
    return _Stage(
        read.file, read.kind, read.pad, read.recording, read.shown.units, time[first:] - begin,
        (read.shown.way - zero.position)[first:], (read.shown.load - zero.force)[first:],
        read.shown.signs, zero, read.sampling, dropped, (*read.findings, zero.finding, sampled),
        begin,
    )  # fmt: skip


def _in_units(
    file: Path, recording: Recording, answers: Answers
) -> tuple[UnitSystem, list[Floats], str]:
    """Return columns in tidy units: time, way, load and, where it exists, the load's own clock."""
    given = answers.units or (None, None, None)
    channels = [recording.time, recording.way, recording.load]
    units = [_unit(file, channel, stated) for channel, stated in zip(channels, given, strict=True)]
    columns = [
        c.values * u.factor if u.factor != 1.0 else c.values
        for c, u in zip(channels, units, strict=True)
    ]
    clock = {"s": 1.0, "ms": 1e-3, "min": 60.0}
    columns[0] = columns[0] * clock[units[0].tidy]
    if recording.load_time is not None:
        own = _unit(file, recording.load_time, given[0])
        columns.append(recording.load_time.values * own.factor * clock[own.tidy])
    way, load, columns[2] = _with_area(file, units[1], units[2], columns[2], answers.area)
    named = ", ".join(
        f"{c.name} in {_written(c, said)}" for c, said in zip(channels, given, strict=True)
    )
    system = unit_system(way.tidy or STRAIN.displacement, load.tidy)
    return system, columns, f"{named}; written as {way.tidy or '1'} and {load.tidy}"


def _written(channel: Channel, stated: str | None) -> str:
    """Return the unit of a channel as the file or the user states it, and who does."""
    known = any(unit_of(channel.unit, quantity) for quantity in _quantities(channel))
    return channel.unit if known else f"{stated} (as stated by the user)"


def _quantities(channel: Channel) -> tuple[str, ...]:
    """Return the quantities that a channel may hold: a strain may be called displacement."""
    either = (both for both in QUANTITIES if channel.quantity == both[0])
    return next(either, (channel.quantity,))


def _unit(file: Path, channel: Channel, stated: str | None) -> Unit:
    """Return the unit of a channel, as the file or the user states it; both must agree."""
    quantities = _quantities(channel)
    for text in (channel.unit, stated):
        candidates = [unit_of(text, quantity) for quantity in quantities] if text else []
        unit = next((unit for unit in candidates if unit is not None), None)
        if unit is None:
            continue
        if text is channel.unit and stated is not None:
            others = [unit_of(stated, quantity) for quantity in quantities]
            if unit not in others:
                raise InputError(
                    f"'{channel.name}' is in {channel.unit}, and --units says {stated}",
                    file=file,
                    remedy="leave --units out",
                )
        return unit
    written = f"the unit '{channel.unit}'" if channel.unit else "no unit"
    raise UnsureError(
        f"the column '{channel.name}' ({channel.quantity}) has {written}",
        file=file,
        option="units",
        question="units of time, displacement and force, as s,mm,N",
        say="s,mm,N",
    )


def _with_area(
    file: Path, way: Unit, load: Unit, values: Floats, area: float | None
) -> tuple[Unit, Unit, Floats]:
    """Return stress with strain, or force with displacement."""
    strained, stressed = way.quantity == "strain", load.quantity == "stress"
    if strained == stressed:
        return way, load, values
    if area is None:
        wanted = "stress" if strained else "force"
        raise UnsureError(
            f"the file has {way.quantity} and {load.quantity}, and no area to make {wanted} of it",
            file=file,
            option="area",
            question="area of the specimen in mm2",
            say="MM2",
        )
    newtons = {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "nN": 1e-9}
    megapascals = {"MPa": 1.0, "kPa": 1e-3, "Pa": 1e-6}  # 1 MPa is 1 N/mm2
    if strained:
        return way, Unit("stress", "kPa"), values * (1e3 * newtons[load.tidy] / area)
    return way, Unit("force", "N"), values * (megapascals[load.tidy] * area)


def _on_a_clock(
    file: Path, columns: list[Floats], dropped: dict[str, int]
) -> tuple[Floats, Floats, Floats, Sampling]:
    time, way, load, *own = columns
    try:
        if own:
            lag = float(np.median(own[0] - time))
            way, kept = on_one_clock(time, way, own[0], dropped)
            return own[0][kept], way, load[kept], sampling_of(own[0][kept], lag)
        time, (way, load) = rising(time, [way, load], dropped)
    except ClockError as error:
        raise InputError(str(error), file=file, remedy=error.remedy) from error
    return time, way, load, sampling_of(time)


def _signs(file: Path, way: Floats, load: Floats, recording: Recording, answers: Answers) -> Signs:
    signs = find_signs(way, load)
    if answers.sign is not None:
        of_way, of_load = SIGNS[answers.sign]
        return replace(signs, way=of_way, load=of_load, doubt="")
    if recording.pressing:
        return replace(signs, way=1, load=1, doubt="")
    if signs.doubt and is_dead(way, load):
        raise _DeadForceError(
            f"the force does not answer to the displacement: its {len(load)} readings scatter by "
            f"{plain(float(np.std(load)), 2)} about one level",
            file=file,
            remedy="check the load cell and its cable, or leave the file out",
        )
    if signs.doubt:
        raise _unsure_of_sign(file, signs.doubt)
    return signs


def _unsure_of_sign(file: Path, doubt: str) -> UnsureError:
    return UnsureError(
        f"the direction that presses cannot be determined: {doubt}",
        file=file,
        option="sign",
        question="which columns are to be turned over so that pressing is positive "
        f"({', '.join(SIGNS)})",
        say="|".join(SIGNS),
    )


def _sign_finding(signs: Signs, recording: Recording, answers: Answers) -> str:
    turned = [
        channel.name
        for channel, factor in ((recording.way, signs.way), (recording.load, signs.load))
        if factor < 0
    ]
    what = f"turned over: {' and '.join(turned)}" if turned else "kept as written"
    if answers.sign is not None:
        return f"sign {what}, as stated by the user"
    if recording.pressing:
        return f"sign {what}: this layout fixes it"
    return (
        f"sign {what}: taken as pressing, with the largest force at {100.0 * signs.travel:.0f} % "
        f"of the travel, {plain(min(signs.swing, 999.0), 2)} times the largest of the other sign "
        "(a test in tension would look the same)"
    )


def _clocks_finding(recording: Recording, sampling: Sampling) -> str:
    if recording.load_time is None or sampling.lag is None:
        return ""
    return (
        f"; two clocks: {recording.load_time.name} of the force runs "
        f"{sampling.lag * 1e3:.4g} ms behind {recording.time.name} row by row; the displacement "
        "is brought to the force's times"
    )


def _clocks(stages: Sequence[_Stage]) -> list[float | None]:
    """Return the pad's clock at each test's first row, where all its tests state their date."""
    starts: list[float | None] = []
    for stage in stages:
        of_pad = [other for other in stages if other.pad == stage.pad]
        began = [other.began for other in of_pad]
        known = [date for date in began if date is not None]
        whole = len(known) == len(of_pad) > 1 and _in_turn(of_pad, known)
        starts.append(stage.began - known[0] if whole and stage.began is not None else None)
    return starts


def _in_turn(stages: Sequence[_Stage], began: Sequence[float]) -> bool:
    """Return whether each test begins after the one before has ended, to the second."""
    ends = [date + float(stage.time[-1]) for date, stage in zip(began, stages, strict=True)]
    return all(after >= end - 1.0 for end, after in zip(ends, began[1:], strict=False))
