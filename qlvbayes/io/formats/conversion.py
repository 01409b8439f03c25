"""Convert machine files to tidy tests: units, signs, contact, order, with all findings as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.answers import Answers, UnsureError
from qlvbayes.io.formats.binary import WORKBOOK
from qlvbayes.io.formats.catalogue import known_formats
from qlvbayes.io.formats.contact import FirstContact, Signs
from qlvbayes.io.formats.format import Format, Recording
from qlvbayes.io.formats.layouts import Layout, stated_layout
from qlvbayes.io.formats.loading import Loaded, oriented_tests, usable_tests, without_copies
from qlvbayes.io.formats.naming import pads_of, pads_of_tests, tests_of
from qlvbayes.io.formats.recognition import head_of, matching, recognised
from qlvbayes.io.formats.sampling import Sampling
from qlvbayes.io.formats.textfile import is_text
from qlvbayes.io.formats.zero import Zero, zeros
from qlvbayes.io.reading.testchecks import LEAST_SAMPLES
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import of_lines

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
    format: Format
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

    @property
    def prescribed_force(self) -> bool:
        """Return whether the force never changes, as under a dead weight: the test is creep."""
        return bool(np.ptp(self.force) == 0.0)

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
            "specimens, --pad-from REGEX finds the pads' names in the tests', or --pad "
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
    kinds: Sequence[Format] | None = None,
    *,
    without_faulty: bool = False,
) -> Conversion:
    """Read machine files and convert them to tidy tests; ``kinds`` are all known by default."""
    kinds = known_formats() if kinds is None else kinds
    pads = pads_of(files, answers.pads)  # None: one a test
    faults: dict[Path, InputError] = {}
    loaded: list[Loaded] = []
    for file, pad in zip(files, pads or [""] * len(files), strict=True):
        try:
            kind, recordings = _read(file, kinds, answers)
            loaded += usable_tests(file, kind, recordings, pad, answers)
        except InputError as error:
            faults[file] = error
    read: list[Loaded] = []
    for file in dict.fromkeys(one.file for one in loaded):
        try:
            read += oriented_tests([one for one in loaded if one.file == file], loaded, answers)
        except InputError as error:
            faults[file] = error
    one_by_one = pads is None or bool(answers.tests)  # no test may be left out of those named
    if pads is None and not faults:
        own = pads_of_tests([one.named for one in read], files, answers.pads)
        read = [replace(one, pad=pad) for one, pad in zip(read, own, strict=True)]
    read = without_copies(read)
    pairs = list(zip(read, zeros(read, answers), strict=True))
    for one, zero in pairs:
        if isinstance(zero, UnsureError):
            faults.setdefault(one.file, zero)
    if faults and (not without_faulty or len(faults) == len(set(files)) or one_by_one):
        raise next(faults[file] for file in files if file in faults)
    used = [(one, z) for one, z in pairs if one.file not in faults and isinstance(z, Zero)]
    if not used:
        raise InputError("no test can be used", file=files[0], remedy="look at the file")
    firsts = [_first_row(one, zero) for one, zero in used]
    names = tests_of([(one.pad, one.recording.name, one.file) for one, _ in used], answers.tests)
    units = used[0][0].units
    tests = [
        _tidied(one, zero, first, name, units, clock)
        for (one, zero), first, name, clock in zip(
            used, firsts, names, _clocks([one for one, _ in used], firsts), strict=True
        )
    ]
    pads_stated = bool(answers.pads) or answers.pad_from is not None
    undivided = not pads_stated and bool(_together(tests))
    return Conversion(tuple(tests), units, tuple(faults.values()), undivided)


def _together(tests: Sequence[Tidied]) -> list[Tidied]:
    """Return the tests of files that hold several."""
    in_file = Counter(test.file for test in tests)
    return [test for test in tests if in_file[test.file] > 1]


def _read(
    file: Path, kinds: Sequence[Format], answers: Answers
) -> tuple[Format, Sequence[Recording]]:
    """Return a file's layout and recordings; an error of a format's code becomes an InputError."""
    kind: Format
    if answers.columns is None:
        kind = recognised(file, kinds)
        read: Callable[[], Sequence[Recording]] = partial(kind.read, file)
    else:
        head = head_of(file)
        whole, _, _ = matching(head, kinds)
        own = whole[0] if len(whole) == 1 else None
        kind = stated = stated_layout(
            answers.columns, file, own if isinstance(own, Layout) else None
        )
        read = partial(stated.read, file)
        if own is WORKBOOK:
            read = partial(WORKBOOK.tests_in, file, stated)
        elif not is_text(head):
            raise InputError("this is no table of text", file=file, remedy="leave --columns out")
    try:
        return kind, read()
    except InputError:
        raise
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(
            f"the file cannot be read as {kind.name} ({text})",
            file=file,
            remedy="export it again",
        ) from error


def _first_row(one: Loaded, zero: Zero) -> int:
    """Return the first row that is kept: none is long before the contact that the test shows."""
    contact = zero.contact
    if contact is None or contact is not one.contact:
        return 0
    first = int(np.searchsorted(one.time, one.time[contact.rows] - LEAD))
    if len(one.time) - first < LEAST_SAMPLES:
        remedy = "export the whole test"
        what = f"only {len(one.time) - first} rows are left"
        raise InputError(what, file=one.file, remedy=remedy)
    return first


def _tidied(
    one: Loaded, zero: Zero, first: int, name: str, units: UnitSystem, start: float | None
) -> Tidied:
    """Return a test with its name and zero, in the units of all tests, from its first row on."""
    if units.dimensionless != one.units.dimensionless:
        raise InputError(
            "this file has strain and stress and others have displacement and force",
            file=one.file,
            remedy="convert them one by one",
        )
    if first:
        one.dropped[f"rows of the approach, more than {LEAD:g} s before contact"] = first
    way, load = one.way[first:] - zero.position, one.load[first:] - zero.force
    sd = zero.sd
    if units != one.units:
        length, newtons = (one.units.factor_to(units, kind) for kind in ("displacement", "force"))
        way, load, sd = way * length, load * newtons, None if sd is None else sd * length
    sampled = one.sampling.describe() + _clocks_finding(one)
    return Tidied(
        one.file, one.kind, one.pad, name, one.named, units, one.time[first:] - one.time[first],
        way, load, start, one.signs, zero.contact, zero.position, sd, zero.stage, one.sampling,
        one.dropped, (*one.findings, zero.finding, sampled),
    )  # fmt: skip


def _clocks_finding(one: Loaded) -> str:
    recording, lag = one.recording, one.sampling.lag
    if recording.load_time is None or lag is None:
        return ""
    return (
        f"; two clocks: {recording.load_time.name} of the force runs {lag * 1e3:.4g} ms behind "
        f"{recording.time.name} row by row; the displacement is brought to the force's times"
    )


def _clocks(read: Sequence[Loaded], firsts: Sequence[int]) -> list[float | None]:
    """Return the pad's clock at each test's first row, where all its tests state their date."""
    began = [
        None if one.recording.began is None else one.recording.began + float(one.time[first])
        for one, first in zip(read, firsts, strict=True)
    ]
    starts: list[float | None] = []
    for one, own in zip(read, began, strict=True):
        of_pad = [k for k, other in enumerate(read) if other.pad == one.pad]
        dates = [date for k in of_pad if (date := began[k]) is not None]
        spans = [float(read[k].time[-1] - read[k].time[firsts[k]]) for k in of_pad]
        whole = len(dates) == len(of_pad) > 1 and _in_turn(dates, spans)
        starts.append(own - dates[0] if whole and own is not None else None)
    return starts


def _in_turn(began: Sequence[float], spans: Sequence[float]) -> bool:
    """Return whether each test begins after the one before has ended, to the second."""
    ends = [date + span for date, span in zip(began, spans, strict=True)]
    return all(after >= end - 1.0 for end, after in zip(ends, began[1:], strict=False))
