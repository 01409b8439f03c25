"""Bring the recordings of a file into tidy units and in order, with pressing positive."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.columns import is_mean
from qlvbayes.io.contact import (
    FirstContact,
    Signs,
    find_signs,
    first_rises,
    is_dead,
    is_driven_back,
    rest_of,
    scatter,
)
from qlvbayes.io.formats import Format
from qlvbayes.io.header import named_columns
from qlvbayes.io.readings import (
    LEAST_SAMPLES,
    Sampling,
    in_tidy_units,
    no_readings,
    on_one_clock,
    out_of_range,
    rising,
    same_readings,
    sampling_of,
    unread_rows,
    wrong_signs,
)
from qlvbayes.io.recording import Recording, UnsureError
from qlvbayes.io.units import UnitSystem, named_units
from qlvbayes.io.wording import joined, listed, of_lines, plain

SIGNS = {"none": (1, 1), "displacement": (-1, 1), "force": (1, -1), "both": (-1, -1)}
"""Choices of the columns that change sign, with the factors of displacement and force."""
FILE = "file"  # value of --contact that stands for the file's own zero
_REST = 0.01  # share of the peak force below which a test begins without force
_NEAR = 0.01  # share of the travel within which a first row is at the file's own zero
_AGREES = 2.0  # standard errors within which two values agree


@dataclass(frozen=True)
class Answers:
    """Answers that the user gives beforehand; None or empty where the files shall decide."""

    sign: str | None = None  # a key of ``SIGNS``
    # displacement at first contact, as the file writes it, or ``FILE``
    contact: float | str | None = None
    units: tuple[str, str, str] | None = None  # units of time, displacement and force
    area: float | None = None  # the specimen's area (mm2)
    pads: tuple[str, ...] = ()  # one name for all, one a file, or one a test
    tests: tuple[str, ...] = ()
    pad_from: re.Pattern[str] | None = None  # the pattern that finds a pad's name in a test's own
    # the columns of time, displacement and force, by name or by number from 1
    columns: tuple[str, str, str] | None = None

    @classmethod
    def from_words(cls, **words: Any) -> Answers:
        """Return answers from the words of the command line, by the names of the fields."""
        if words.get("sign") is not None:
            check_known("sign", words["sign"], SIGNS)
        if (area := words.get("area")) is not None and not area > 0.0:
            raise InputError(f"the area {area:g} is not positive", remedy="give it in mm2")
        if words.get("pad_from") is not None and words.get("pads"):
            remedy = "give one of them"
            raise InputError("--pad and --pad-from both name the pads", remedy=remedy)
        read: dict[str, Callable[[str], Any]] = {
            "contact": _position,
            "units": named_units,
            "pad_from": pattern_of,
            "columns": named_columns,
        }
        said: dict[str, Any] = {key: word for key, word in words.items() if word is not None}
        said |= {key: read[key](word) for key, word in said.items() if key in read}
        return cls(**said)


def _position(text: str) -> float | str:
    try:
        return text if text == FILE else float(text)
    except ValueError:
        remedy = f"give it in the unit of the tidy file, or '{FILE}' for the file's own zero"
        raise InputError(f"no position of contact {text!r}", remedy=remedy) from None


def pattern_of(text: str) -> re.Pattern[str]:
    """Return the pattern that finds a pad's name in a test's; raise InputError where it is none."""
    try:
        return re.compile(text)
    except (re.error, RecursionError, OverflowError) as error:
        remedy = "write for example '^[A-Z]+', which finds AA in AA1"
        what = f"'{text[:200]}' is no pattern of pads' names ({error})"
        raise InputError(what, remedy=remedy) from None


@dataclass(frozen=True, eq=False)
class Loaded:
    """A test of a machine's file in tidy units, and what was found of it, each with its numbers.

    ``signs`` are those that it shows; once it is oriented, they are the factors by which pressing
    has become positive, and ``contact`` is its first contact, None where it shows none; ``sliding``
    is the contact of a platen whose guide rubs before, if that is what the first rise may be. Once
    it is tidy, ``zero`` was subtracted from the displacement and ``tare`` from the force.
    ``zero_sd`` is the former's standard error, where it was measured; tests of one
    ``contact_stage`` share it. ``tare_sd`` is the latter's, 0 where it was not measured.
    """

    file: Path
    format: Format
    recording: Recording
    units: UnitSystem
    time: Floats  # (n,) in s; a tidy test begins at zero
    displacement: Floats  # (n,) in ``units``
    force: Floats
    sampling: Sampling
    dropped: dict[str, int]
    signs: Signs
    dead: bool  # whether the force does not answer to the displacement
    findings: tuple[str, ...]
    pad: str = ""
    test: str = ""
    contact: FirstContact | None = None
    sliding: FirstContact | None = None
    start_s: float | None = None  # the pad's clock at the first row, where the files state it
    zero: float = 0.0
    tare: float = 0.0
    zero_sd: float | None = None
    contact_stage: str = ""
    tare_sd: float = 0.0

    @property
    def named(self) -> str:
        """Return the test's name in the file, or the file's."""
        return self.recording.name or self.file.stem

    @property
    def stage(self) -> tuple[object, ...]:
        """Return what is equal for recordings whose displacement may have one zero."""
        return self.pad, self.format.name, self.units, self.signs.way

    @property
    def peak(self) -> float:
        """Return the largest force."""
        return float(self.force.max())

    @property
    def approached(self) -> bool:
        """Return whether it moved before the force began to rise, or rests without a force."""
        return self.contact is not None and (
            self.contact.is_beyond(float(self.displacement[0]))
            or abs(self.contact.force) <= _REST * self.peak
        )

    @property
    def moved(self) -> int:
        """Return the first row that is not at the first position."""
        return rest_of(self.displacement)

    @property
    def force_at_first(self) -> float:
        """Return the force at the first position alone: in a test that moves at once it rises."""
        return float(np.median(self.force[: max(self.moved, 1)]))

    def begins_with(self, force: float) -> bool:
        """Return whether the force at the first position is this one, within the noise."""
        off = abs(self.force_at_first - force)
        return off <= max(_REST * self.peak, _AGREES * scatter(self.force))

    @property
    def begins_at_zero(self) -> bool:
        """Return whether the first position is the file's own zero."""
        return abs(float(self.displacement[0])) <= _NEAR * float(np.ptp(self.displacement))

    @property
    def prescribed_force(self) -> bool:
        """Return whether the force never changes, as under a dead weight: the test is creep."""
        return bool(np.ptp(self.force) == 0.0)

    def written(self, displacement: float) -> str:
        """Return a displacement as text with its sign in the file."""
        return f"{self.signs.way * displacement:.6g}"

    def as_dict(self) -> dict[str, object]:
        """Return the conversion of this test as a dictionary for JSON."""
        contact = self.contact
        return {
            "file": str(self.file),
            "format": self.format.name,
            "pad": self.pad,
            "test": self.test,
            "units": asdict(self.units),
            "turned": {"displacement": self.signs.way < 0, "force": self.signs.load < 0},
            "contact": contact and {"place": contact.position, "sd": contact.sd},
            "zero": self.zero,
            "zero_sd": self.zero_sd,
            "contact_stage": self.contact_stage or None,
            "tare_sd": self.tare_sd,
            "rows": len(self.time),
            "step_s": self.sampling.step,
            "lag_s": self.sampling.lag,
            "start_s": self.start_s,
            "dropped": self.dropped,
            "findings": list(self.findings),
        }


def usable_tests(
    file: Path, kind: Format, recordings: Sequence[Recording], answers: Answers
) -> list[Loaded]:
    """Return the tests of a file in which something moves, in tidy units and in order."""
    means = [recording for recording in recordings if is_mean(recording.name)]
    means = means if len(means) < len(recordings) else []
    lost = {f"rows of the mean specimen '{one.name}'": len(one.time.values) for one in means}
    whole = [_without_missing(one) for one in recordings if one not in means]
    moving = [one for one in whole if not _is_still(one)]
    if not moving:  # under a dead weight the force never changes
        moving = [one for one in whole if not _is_still(one, prescribed=True)]
    if still := sum(len(one.time.values) for one in whole if one not in moving):
        lost["rows of parts in which nothing moves"] = still
    if not moving:
        counts = [of_lines(n, why) for one in whole for why, n in one.dropped.items()]
        left_out = f" ({', '.join(counts[:3])} are left out)" if counts else ""
        raise InputError(
            f"no test of {LEAST_SAMPLES} rows or more in which displacement and force change"
            + left_out,
            file=file,
            remedy="check the channels or export it again",
        )
    loaded = [_in_order(file, kind, recording, answers) for recording in moving]
    loaded[0].dropped.update(lost)
    return loaded


def _without_missing(recording: Recording) -> Recording:
    """Return the recording without rows in which a channel has no number or a code."""
    if recording.load_time is not None and len(recording.load_time.values) != len(
        recording.time.values
    ):
        return recording  # of a bag, in which each channel has rows of its own
    channels = (recording.time, recording.way, recording.load)
    missing = [no_readings(c.values, coded=c is not recording.time) for c in channels]
    lost = np.logical_or.reduce([rows for rows, _ in missing])
    if not lost.any():
        return recording
    dropped = dict(recording.dropped)
    for channel, (rows, codes) in zip(channels, missing, strict=True):
        if rows.any():
            what = f"a code for no reading ({codes})" if codes else "no number"
            dropped[f"rows with {what} in {channel.name}"] = int(np.count_nonzero(rows))
    return replace(recording.changed(itemgetter(~lost)), dropped=dropped)


def _is_still(recording: Recording, *, prescribed: bool = False) -> bool:
    """Return whether a channel never changes, but for a ``prescribed`` force on what creeps."""
    way, load = recording.way.values, recording.load.values
    if len(way) < LEAST_SAMPLES or np.ptp(way) == 0.0:
        return True
    rests = prescribed and load[0] != 0.0 and not is_driven_back(way)
    return bool(np.ptp(load) == 0.0) and not rests


def _in_order(file: Path, kind: Format, recording: Recording, answers: Answers) -> Loaded:
    units, columns, finding = in_tidy_units(file, recording, answers.units, answers.area)
    dropped = dict(recording.dropped)
    time, way, load, *own = columns
    lag = None
    if own:
        lag = float(np.median(own[0] - time)) if len(own[0]) == len(time) else None
        time, (way,) = rising(time, [way], {}, file)
        own_time, (load,) = rising(own[0], [load], dropped, file)
        way, kept = on_one_clock(time, way, own_time, dropped, file)
        time, load = own_time[kept], load[kept]
    time, (way, load) = rising(time, [way, load], dropped, file)
    if unread := unread_rows(time, way, load):
        dropped["rows before the channels were read, both exactly 0"] = unread
        time, way, load = time[unread:], way[unread:], load[unread:]
    what = out_of_range(time, {recording.way.name: way, recording.load.name: load})
    if what is not None:
        raise InputError(f"{what}, which no rig measures", file=file, remedy="check the units")
    return Loaded(
        file, kind, recording, units, time, way, load, sampling_of(time, lag), dropped,
        find_signs(way, load), is_dead(way, load), (f"units {finding}",),
    )  # fmt: skip


# Signs


def oriented_tests(
    own: Sequence[Loaded], every: Sequence[Loaded], answers: Answers
) -> list[Loaded]:
    """Return a file's tests in which pressing is positive; dead ones go where others are not."""
    known = answers.sign is not None
    unclear = [
        one for one in own if one.dead and one.signs.doubt and not (known or one.recording.pressing)
    ]
    prepared = [_oriented(one, every, answers) for one in own if one not in unclear]
    if not prepared:
        raise InputError(
            f"the force does not answer to the displacement: its {len(own[0].force)} readings "
            f"scatter by {plain(float(np.std(own[0].force)), 2)} about one level",
            file=own[0].file,
            remedy="check the load cell and its cable, or leave the file out",
        )
    live = [one for one in prepared if not one.dead] or prepared
    live[0].dropped.update(own[0].dropped)
    for test in (*unclear, *(one for one in prepared if one not in live)):
        name = f"rows of '{test.recording.name}', in which the force does not answer"
        live[0].dropped[name] = len(test.recording.time.values)
    return live


def _oriented(one: Loaded, every: Sequence[Loaded], answers: Answers) -> Loaded:
    """Return a recording in which pressing is positive, with the contact that it shows."""
    signs, why = _signs(one, every, answers)
    way, load = one.displacement * signs.way, one.force * signs.load
    wrong = wrong_signs(way, load)
    if wrong and not (one.units.dimensionless and len(wrong) > 1):
        what = f"the specimen is pressed with {joined([*wrong])} negative"
        if answers.sign is None:
            raise _unsure_of_sign(one.file, what)
        remedy = "leave --sign out"
        raise InputError(f"with --sign {answers.sign} {what}", file=one.file, remedy=remedy)
    constant = float(np.ptp(load)) == 0.0
    contact = sliding = None
    if not (one.units.dimensionless or constant):
        contact, sliding = first_rises(way, load, at_zero=one.begins_at_zero)
    pairs = ((one.recording.way, signs.way), (one.recording.load, signs.load))
    turned = [channel.name for channel, factor in pairs if factor < 0]
    unused = one.recording.unused
    findings = [*one.findings, *([f"columns not used: {listed(unused)}"] if unused else [])]
    findings.append(
        f"sign turned over: {' and '.join(turned)}{why}" if turned else f"sign kept as written{why}"
    )
    if constant:
        findings.append(
            f"the force is {plain(float(one.force[0]))} {one.units.force} in every row: it is "
            "taken as prescribed, and the test as creep (column control)"
        )
    return replace(
        one, displacement=way, force=load, signs=signs, contact=contact, sliding=sliding,
        findings=tuple(findings),
    )  # fmt: skip


def _signs(one: Loaded, every: Sequence[Loaded], answers: Answers) -> tuple[Signs, str]:
    """Return signs and why: one for a file and layout, from parts that begin at rest."""
    if answers.sign is not None:
        of_way, of_load = SIGNS[answers.sign]
        return replace(one.signs, way=of_way, load=of_load), ", as stated by the user"
    if one.recording.pressing:
        return replace(one.signs, way=1, load=1), ": this layout fixes it"
    names = one.format.name, one.recording.way.name, one.recording.load.name
    alike = [
        other
        for other in every
        if other.signs.rank
        and (other.format.name, other.recording.way.name, other.recording.load.name) == names
    ]
    within = [other for other in alike if other.file == one.file]
    if within:
        first = max(within, key=lambda other: (other.signs.rank, float(np.ptp(other.force))))
        found = {(first.signs.way, first.signs.load)}
    else:
        found = {(other.signs.way, other.signs.load) for other in alike}
    if len(found) != 1:
        raise _unsure_of_sign(one.file, one.signs.doubt)
    why = ": taken from the parts or files of this layout that begin at rest"
    if one.signs.rank:
        why = (
            f": taken as pressing, with the largest force at {one.signs.travel:.0%} of the travel "
            "(a test in tension would look the same)"
        )
    ((of_way, of_load),) = found
    return replace(one.signs, way=of_way, load=of_load), why


def _unsure_of_sign(file: Path, doubt: str) -> UnsureError:
    return UnsureError(
        f"the direction that presses cannot be determined: {doubt}",
        file=file,
        option="sign",
        question="which columns are to be turned over so that pressing is positive "
        f"({', '.join(SIGNS)})",
        say="|".join(SIGNS),
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
        finding = f"'{one.named}' ({names}) has the same readings and is left out"
        other = kept[same]
        recording = other.recording
        if recording.name.isdecimal() and other.file == one.file:
            recording = replace(recording, name="")  # a number that told them apart
        findings = (*other.findings, finding)
        kept[same] = replace(other, recording=recording, findings=findings)
    return kept


def _equal(one: Loaded, other: Loaded) -> bool:
    """Return whether two records are equal within the digits in which they are written."""
    units = one.units.dimensionless == other.units.dimensionless
    if one.pad != other.pad or len(one.time) != len(other.time) or not units:
        return False
    way, load = (one.units.factor_to(other.units, kind) for kind in ("displacement", "force"))
    return (
        one.recording.stated.began == other.recording.stated.began
        and same_readings(one.time - one.time[0], other.time - other.time[0])
        and same_readings(one.displacement * way, other.displacement)
        and same_readings(one.force * load, other.force)
    )
