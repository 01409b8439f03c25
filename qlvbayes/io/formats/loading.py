"""Bring the recordings of a file into tidy units and in order, with pressing positive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import SIGNS, Answers
from qlvbayes.io.formats.columns import NamedColumn, refuse_unknown_unit
from qlvbayes.io.formats.contact import (
    FirstContact,
    Signs,
    find_contact,
    find_signs,
    force_at_start,
    is_dead,
    scatter,
)
from qlvbayes.io.formats.format import Channel, Format, Recording, UnsureError
from qlvbayes.io.formats.machineunits import QUANTITIES, Unit, unit_of
from qlvbayes.io.formats.naming import is_mean, pad_in
from qlvbayes.io.formats.sampling import ClockError, Sampling, on_one_clock, rising, sampling_of
from qlvbayes.io.reading.noreading import no_readings, out_of_range, same_readings
from qlvbayes.io.reading.testchecks import LEAST_SAMPLES, wrong_signs
from qlvbayes.io.reading.unread import UNREAD, unread_rows
from qlvbayes.io.units import STRAIN, UnitSystem, unit_system
from qlvbayes.io.wording import joined, listed, of_lines, plain

_REST = 0.01  # share of the peak force below which a test begins without force
_NEAR = 0.01  # share of the travel within which a first row is at the file's own zero
_STILL = 1e-3  # share of the travel within which rows at the beginning are at one position
_AGREES = 2.0  # standard errors within which two values agree
_RISEN = 0.3  # share of the peak force at which the speed of the approach is read


@dataclass(frozen=True, eq=False)
class Loaded:
    """A recording in tidy units and in order: ``time`` (s), ``way`` and ``load`` (n,) in ``units``.

    ``signs`` are those that it shows; once it is oriented, they are the factors by which pressing
    has become positive, and ``contact`` is its first contact, None where it shows none.
    """

    file: Path
    kind: Format
    pad: str
    recording: Recording
    units: UnitSystem
    time: Floats
    way: Floats
    load: Floats
    sampling: Sampling
    dropped: dict[str, int]
    signs: Signs
    findings: tuple[str, ...]
    contact: FirstContact | None = None

    @property
    def named(self) -> str:
        """Return the test's name in the file, or the file's."""
        return self.recording.name or self.file.stem

    @property
    def of_layout(self) -> tuple[str, str, str]:
        """Return what is equal for recordings whose columns have the same signs."""
        return self.kind.name, self.recording.way.name, self.recording.load.name

    @property
    def stage(self) -> tuple[object, ...]:
        """Return what is equal for recordings whose displacement may have one zero."""
        return self.pad, self.kind.name, self.units, self.signs.way

    @property
    def peak(self) -> float:
        """Return the largest force."""
        return float(self.load.max())

    @property
    def approached(self) -> bool:
        """Return whether it moved before the force began to rise, or rests without a force."""
        if self.contact is None:
            return False
        travelled = self.contact.position - float(self.way[0]) > _AGREES * self.contact.sd
        return travelled or abs(self.contact.force) <= _REST * self.peak

    @property
    def speed(self) -> float:
        """Return the speed from before contact until the force has risen, 0 where it shows none."""
        before = max(self.contact.rows - 1, 0) if self.contact is not None else 0
        start = force_at_start(self.way, self.load)
        risen = self.load[before + 1 :] >= start + _RISEN * (self.peak - start)
        after = before + 1 + int(np.argmax(risen))
        moved = float(self.way[after] - self.way[before])
        return abs(moved) / float(self.time[after] - self.time[before])

    @property
    def force_at_first(self) -> float:
        """Return the force at the first position alone: in a test that moves at once it rises."""
        moved = np.abs(self.way - self.way[0]) > _STILL * float(np.ptp(self.way))
        return float(np.median(self.load[: max(int(np.argmax(moved)), 1)]))

    @property
    def begins_without_force(self) -> bool:
        """Return whether the force at the first position is none, within the noise."""
        return abs(self.force_at_first) <= max(_REST * self.peak, _AGREES * scatter(self.load))

    @property
    def begins_at_zero(self) -> bool:
        """Return whether the first position is the file's own zero."""
        return abs(float(self.way[0])) <= _NEAR * float(np.ptp(self.way))

    def written(self, displacement: float) -> str:
        """Return a displacement as text with its sign in the file."""
        return f"{self.signs.way * displacement:.6g}"


def usable_tests(
    file: Path,
    kind: Format,
    recordings: Sequence[Recording],
    pad: str,
    answers: Answers,
) -> list[Loaded]:
    """Return the tests of a file in which something moves, in tidy units and in order."""
    recordings, dropped = _without_means(recordings)
    recordings = [_without_missing(recording) for recording in recordings]
    moving = [one for one in recordings if not _is_still(one)]
    if not moving:  # under a dead weight the force never changes
        moving = [one for one in recordings if not _is_still(one, prescribed=True)]
    still = sum(len(one.time.values) for one in recordings if one not in moving)
    if still:
        dropped["rows of parts in which nothing moves"] = still
    if not moving:
        raise InputError(
            f"no test of {LEAST_SAMPLES} rows or more in which displacement and force change"
            + _left_out(recordings),
            file=file,
            remedy="check the channels or export it again",
        )
    loaded = []
    for recording in moving:
        own = pad
        if answers.pad_from is not None:
            own = pad_in(recording.name or file.stem, answers.pad_from)
        loaded.append(_in_order(file, kind, recording, own, answers))
    loaded[0].dropped.update(dropped)
    return loaded


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


def _is_still(recording: Recording, *, prescribed: bool = False) -> bool:
    """Return whether a channel never changes; a ``prescribed`` force may rest, but not at zero."""
    way, load = recording.way.values, recording.load.values
    if len(way) < LEAST_SAMPLES or np.ptp(way) == 0.0:
        return True
    return bool(np.ptp(load) == 0.0) and not (prescribed and load[0] != 0.0)


def _in_order(file: Path, kind: Format, recording: Recording, pad: str, answers: Answers) -> Loaded:
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
    what = out_of_range(time, {recording.way.name: way, recording.load.name: load})
    if what is not None:
        raise InputError(f"{what}, which no rig measures", file=file, remedy="check the units")
    return Loaded(
        file, kind, pad, recording, units, time, way, load, sampling, dropped,
        find_signs(way, load), (f"units {unit_finding}",),
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


class _DeadForceError(InputError):
    """Exception for a test in which the force does not answer to the displacement."""


def oriented_tests(
    own: Sequence[Loaded], every: Sequence[Loaded], answers: Answers
) -> list[Loaded]:
    """Return a file's tests in which pressing is positive; dead ones go where others are not."""
    prepared: list[Loaded] = []
    dropped = dict(own[0].dropped)
    dead: list[InputError] = []
    for one in own:
        try:
            prepared.append(_oriented(one, _signs(one, every, answers), answers))
        except _DeadForceError as error:
            dropped[_dead_rows(one.recording)] = len(one.recording.time.values)
            dead.append(error)
    if not prepared:
        raise dead[0]
    live = [one for one in prepared if not is_dead(one.way, one.load)]
    if live:
        lost = [one.recording for one in prepared if not any(one is other for other in live)]
        dropped |= {_dead_rows(one): len(one.time.values) for one in lost}
    kept = live or prepared
    kept[0].dropped.update(dropped)
    return kept


def _dead_rows(recording: Recording) -> str:
    return f"rows of '{recording.name}', in which the force does not answer"


def _oriented(one: Loaded, signs: Signs, answers: Answers) -> Loaded:
    """Return a recording in which pressing is positive, with the contact that it shows."""
    way, load = one.way * signs.way, one.load * signs.load
    wrong = wrong_signs(way, load)
    if wrong and not (one.units.dimensionless and len(wrong) > 1):
        what = f"the specimen is pressed with {joined([*wrong])} negative"
        if answers.sign is None:
            raise _unsure_of_sign(one.file, what)
        remedy = "leave --sign out"
        raise InputError(f"with --sign {answers.sign} {what}", file=one.file, remedy=remedy)
    constant = float(np.ptp(load)) == 0.0
    contact = None if one.units.dimensionless or constant else find_contact(way, load)
    unused = one.recording.unused
    findings = [
        *one.findings,
        *([f"columns not used: {listed(unused)}"] if unused else []),
        _sign_finding(one, signs, answers),
    ]
    if constant:
        findings.append(
            f"the force is {plain(float(one.load[0]))} {one.units.force} in every row: it is taken "
            "as prescribed, and the test as creep (column control)"
        )
    return replace(one, way=way, load=load, signs=signs, contact=contact, findings=tuple(findings))


def _signs(one: Loaded, every: Sequence[Loaded], answers: Answers) -> Signs:
    """Return the signs of a recording: one for a file and layout, from parts that begin at rest."""
    if answers.sign is not None:
        of_way, of_load = SIGNS[answers.sign]
        return replace(one.signs, way=of_way, load=of_load, doubt="")
    if one.recording.pressing:
        return replace(one.signs, way=1, load=1, doubt="")
    if one.signs.doubt and is_dead(one.way, one.load):
        raise _DeadForceError(
            f"the force does not answer to the displacement: its {len(one.load)} readings scatter "
            f"by {plain(float(np.std(one.load)), 2)} about one level",
            file=one.file,
            remedy="check the load cell and its cable, or leave the file out",
        )
    alike = [other for other in every if other.of_layout == one.of_layout and other.signs.rank]
    within = [other for other in alike if other.file == one.file]
    if within:
        first = max(within, key=lambda other: (other.signs.rank, float(np.ptp(other.load))))
        return replace(one.signs, way=first.signs.way, load=first.signs.load, doubt="")
    found = {(other.signs.way, other.signs.load) for other in alike}
    if len(found) != 1:
        raise _unsure_of_sign(one.file, one.signs.doubt)
    way, load = found.pop()
    return replace(one.signs, way=way, load=load, doubt="")


def _unsure_of_sign(file: Path, doubt: str) -> UnsureError:
    return UnsureError(
        f"the direction that presses cannot be determined: {doubt}",
        file=file,
        option="sign",
        question="which columns are to be turned over so that pressing is positive "
        f"({', '.join(SIGNS)})",
        say="|".join(SIGNS),
    )


def _sign_finding(one: Loaded, signs: Signs, answers: Answers) -> str:
    recording = one.recording
    pairs = ((recording.way, signs.way), (recording.load, signs.load))
    turned = [channel.name for channel, factor in pairs if factor < 0]
    what = f"turned over: {' and '.join(turned)}" if turned else "kept as written"
    if answers.sign is not None:
        return f"sign {what}, as stated by the user"
    if recording.pressing:
        return f"sign {what}: this layout fixes it"
    if not one.signs.rank:
        return f"sign {what}: taken from the parts or files of this layout that begin at rest"
    return (
        f"sign {what}: taken as pressing, with the largest force at {100.0 * signs.travel:.0f} % "
        f"of the travel, {plain(min(signs.swing, 999.0), 2)} times the largest of the other sign "
        "(a test in tension would look the same)"
    )


def without_copies(read: Sequence[Loaded]) -> list[Loaded]:
    """Return the records without those that are equal, after conversion, to one before of the pad.

    A machine may write one force in N and in kgf, side by side, below one another or in two files.
    """
    kept: list[Loaded] = []
    for one in read:
        same = next((k for k, other in enumerate(kept) if _equal(one, other)), None)
        if same is None:
            kept.append(one)
            continue
        names = f"{one.recording.way.name} and {one.recording.load.name}"
        units = f"{one.recording.way.unit} and {one.recording.load.unit}"
        finding = f"'{one.named}' ({names} in {units}) has the same readings and is left out"
        other = kept[same]
        kept[same] = replace(other, findings=(*other.findings, finding))
    alone = Counter(one.file for one in kept)
    before = Counter(one.file for one in read)
    return [
        replace(one, recording=replace(one.recording, name=""))
        if alone[one.file] == 1 < before[one.file] and one.recording.name.isdecimal()
        else one
        for one in kept
    ]


def _equal(one: Loaded, other: Loaded) -> bool:
    """Return whether two records are equal within the digits in which they are written."""
    units = one.units.dimensionless == other.units.dimensionless
    if one.pad != other.pad or len(one.time) != len(other.time) or not units:
        return False
    if one.recording.began != other.recording.began:
        return False
    way, load = (one.units.factor_to(other.units, kind) for kind in ("displacement", "force"))
    pairs = {
        "time": (one.time - one.time[0], other.time - other.time[0]),
        "way": (one.way * way, other.way),
        "load": (one.load * load, other.load),
    }
    rounded = {
        part: getattr(one.recording, part).unit != getattr(other.recording, part).unit
        for part in pairs
    }
    return all(same_readings(*pair, rounded=rounded[part]) for part, pair in pairs.items())
