"""Parts of tests that a user chooses: those that are used, and readings of force that are left out.

A part is used such as the one before the specimen tears. Readings of force are left out by a column
of the file or by name: their displacement stays, as the specimen remembers what was done to it
there. Only their force does not count, in the fit as in all that is measured from the readings.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.readings import LEAST_SAMPLES
from qlvbayes.io.units import SUFFIXES, UnitSystem
from qlvbayes.io.wording import joined, plain
from qlvbayes.motion.clean import Reasons, UnusedReadings, without
from qlvbayes.motion.phases import KINDS, NAMES, Phase, phase_index

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SPAN = re.compile(rf"(?P<test>.+):(?P<low>{_NUMBER})?\.\.(?P<high>{_NUMBER})?\s*(?P<unit>\D*)")
_KINDS = {**{kind: kind for kind in KINDS}, **{name: kind for kind, name in NAMES.items()}}
_PHASE = re.compile(rf"(?P<test>.+):\s*(?P<kind>{'|'.join(_KINDS)})(?:\s+(?P<number>\d+))?")
_USE, _LEAVE_OUT = "--use", "--leave-out"
_REMEDIES = {
    _USE: "write --use 'TEST:0..18mm' for its part to a displacement, 'TEST:0..12s' to a time",
    _LEAVE_OUT: f"write {_LEAVE_OUT} 'TEST:30..45s' for a time, 'TEST:0..0.1mm' for a "
    "displacement, 'TEST:hold 2' for a phase",
}
_NAMED = 3  # spans of time that are named


@dataclass(frozen=True)
class PartOfTest:
    """A part of a test by the command line: times (s) or displacements, or phases of one kind."""

    option: str
    text: str
    test: str
    # low, high: in ``unit``
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""
    kind: str = ""  # of its phases, of which the number-th is meant, from 1 on; None: all of them
    number: int | None = None

    def names(self, test: Test) -> bool:
        """Return whether it is of this test, by the test's name or PAD/TEST."""
        return self.test in (test.name, f"{test.pad}/{test.name}")

    def values(self, test: Test, pad: Pad, begun: float = 0.0) -> NDArray[np.float64]:
        """Return the times or displacements (n,) of a test in the part's unit."""
        if self.unit in SUFFIXES["time"]:
            scale = SUFFIXES["time"][self.unit]
            return (test.time + begun) * scale.down / scale.up
        if not self.unit:
            return test.displacement
        if pad.units.dimensionless:
            what = f"{self.option} {self.text!r}: pad {pad.name} has strain"
            raise InputError(what, remedy=_REMEDIES[self.option])
        own = SUFFIXES["displacement"][pad.units.displacement]
        ratio = own.over(SUFFIXES["displacement"][self.unit])
        return test.displacement * ratio.up / ratio.down

    def rows(self, test: Test, pad: Pad, begun: float, phases: Sequence[Phase]) -> Mask:
        """Return which readings (n,) lie in it."""
        if not self.kind:
            values = self.values(test, pad, begun)
            mask = (values >= self.low) & (values <= self.high)
        else:
            seen, chosen = Counter[str](), np.zeros(len(phases), dtype=bool)
            for k, phase in enumerate(phases):
                seen[phase.kind] += 1
                chosen[k] = phase.kind == self.kind and self.number in (None, seen[phase.kind])
            if not chosen.any():
                there = [f"{kind} 1 to {n}" if n > 1 else f"{kind} 1" for kind, n in seen.items()]
                raise InputError(
                    f"{self.option} {self.text!r}: test '{test.name}' has no such phase",
                    remedy=f"name one of {', '.join(there)}, or a time as 'TEST:30..45s'",
                )
            mask = np.asarray(chosen[phase_index(phases, test.time)])
        if not mask.any():
            what = f"{self.option} {self.text!r}: test '{test.name}' has no reading there"
            raise InputError(what, remedy=_REMEDIES[self.option])
        return mask

    def of_test(self, test: Test, pad: Pad) -> Test:
        """Return the test from where it reaches ``low`` to where it first exceeds ``high``."""
        values = self.values(test, pad)
        began = np.flatnonzero(values >= self.low)
        first = int(began[0]) if began.size and self.low > max(values[0], 0.0) else 0
        beyond = np.flatnonzero(values[first:] > self.high)
        last = first + int(beyond[0]) if beyond.size else values.size
        if last - first < LEAST_SAMPLES or not began.size:
            raise InputError(
                f"--use {self.text!r} leaves fewer than {LEAST_SAMPLES} rows of test '{test.name}'",
                remedy="widen it",
            )
        rows = np.arange(values.size)
        begin = float(test.time[first]) if first else 0.0
        cut_off = without(test, (rows < first) | (rows >= last))
        changes = (replace(p, start=p.start - begin, stop=p.stop - begin) for p in test.changes)
        start = test.start_s + begin
        return replace(cut_off, time=cut_off.time - begin, start_s=start, changes=tuple(changes))


def _part(text: str, option: str) -> PartOfTest:
    """Read ``TEST:0..18mm`` or ``TEST:hold 2``; raise InputError if the text has another form."""
    remedy, stripped = _REMEDIES[option], text.strip()
    if option == _LEAVE_OUT and (match := _PHASE.fullmatch(stripped)):
        number = None if match["number"] is None else int(match["number"])
        test = match["test"].strip()
        return PartOfTest(option, text, test, kind=_KINDS[match["kind"]], number=number)
    match = _SPAN.fullmatch(stripped)
    units = (*SUFFIXES["time"], *SUFFIXES["displacement"], "")
    if match is None or match["unit"].strip() not in units:
        raise InputError(f"{option} {text!r} is no part of a test", remedy=remedy)
    low, high = float(match["low"] or -np.inf), float(match["high"] or np.inf)
    if not low < high:
        raise InputError(f"{option} {text!r} goes from {low:g} to {high:g}", remedy=remedy)
    return PartOfTest(option, text, match["test"].strip(), low, high, match["unit"].strip())


def parts_of(use: Iterable[str], leave_out: Iterable[str]) -> list[PartOfTest]:
    """Read ``TEST:30..45s`` and ``TEST:hold 2``; raise InputError for any other form."""
    used = [_part(text, _USE) for text in use]
    return used + [_part(text, _LEAVE_OUT) for text in leave_out]


def cut(pad: Pad, use: Sequence[str]) -> tuple[Pad, tuple[str, ...]]:
    """Return a pad with the selected parts of its tests, and a sentence on each cut."""
    tests, notices = list(pad.tests), []
    for part in parts_of(use, ()):
        for k, test in enumerate(tests):
            if part.names(test):
                tests[k] = part.of_test(test, pad)
                used = len(tests[k].time)
                notices.append(
                    f"pad {pad.name}: of test {test.name} {used} rows are used, as stated by "
                    f"{part.text}, and {len(test.time) - used} left out"
                )
    return replace(pad, tests=tuple(tests)), tuple(notices)


def refuse_unknown(pads: Sequence[Pad], use: Sequence[str], leave_out: Sequence[str] = ()) -> None:
    """Raise InputError if a text names a test that no pad has, or cannot be read."""
    tests = [test for pad in pads for test in pad.tests]
    for part in parts_of(use, leave_out):
        if not any(part.names(test) for test in tests):
            names = ", ".join(dict.fromkeys(test.name for test in tests))
            what = f"{part.option}: no test '{part.test}'"
            raise InputError(what, remedy=f"name one of {names[:200]}")


def arguments_of(pads: Sequence[Pad], use: Sequence[str], leave_out: Sequence[str]) -> list[str]:
    """Return the arguments of a command that say of these pads what counts."""
    tests = [test for pad in pads for test in pad.tests]
    return [
        word
        for part in parts_of(use, leave_out)
        if any(part.names(test) for test in tests)
        for word in (part.option, part.text)
    ]


def excluded_readings(
    test: Test,
    pad: Pad,
    leave_out: Sequence[str],
    *,
    begun: float = 0.0,
    phases: Sequence[Phase] = (),
) -> Reasons:
    """Return why the user leaves out the force of each reading (n,) of a test, "" where not."""
    reasons = np.full(test.time.size, "", dtype=object)
    if test.used is not None:
        reasons[~test.used] = "excluded by the column use"
    for part in parts_of((), leave_out):
        if part.names(test):
            mask = part.rows(test, pad, begun, phases)
            reasons[mask & (reasons == "")] = f"excluded by {part.option} {part.text}"
    left = int(np.count_nonzero(reasons == ""))
    if left < LEAST_SAMPLES:
        raise InputError(
            f"of the readings of test '{test.name}' of pad '{test.pad}' {left} are left, and at "
            f"least {LEAST_SAMPLES} are needed",
            remedy="leave out less, or delete the test",
        )
    return reasons


def excluded_notices(
    pad: str, tests: Sequence[tuple[Test, UnusedReadings | None]], units: UnitSystem
) -> Iterator[str]:
    """Yield a sentence on the readings of each test that the user leaves out, by what says so."""
    for test, out in ((test, out) for test, out in tests if out is not None):
        for reason in dict.fromkeys(out.reason[out.excluded]):
            runs = out.runs(reason)
            count, more = sum(run.size for run in runs), len(runs) - _NAMED
            spans = [
                " to ".join(dict.fromkeys(plain(float(out.time[k]), 6) for k in run[[0, -1]]))
                + " s"
                for run in runs[:_NAMED]
            ]
            if more > 0:
                spans.append(f"{more} other span{'s' if more > 1 else ''}")
            readings = "one reading" if count == 1 else f"{count} readings"
            yield (
                f"pad {pad}: of test {test.name} the {units.force_name} of {readings} is left out "
                f"({joined(spans)}), as stated by {reason.removeprefix('excluded by ')}; their "
                f"{units.displacement_name} still counts, as the specimen remembers it"
            )
