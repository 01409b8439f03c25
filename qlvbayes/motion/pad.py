"""Parts of tests that a user chooses: those that are used, and readings of force that are left out.

A part is used such as the one before the specimen tears. Readings of force are left out by a column
of the file or by name: their displacement stays, as the specimen remembers what was done to it
there. Only their force does not count, in the fit as in all that is measured from the readings.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.readings import LEAST_SAMPLES
from qlvbayes.io.units import SUFFIXES, UnitSystem
from qlvbayes.io.wording import joined, plain
from qlvbayes.motion.badreadings import Bad, BadReadings, runs_of
from qlvbayes.motion.phases import KINDS, NAMES, Phase, phase_index

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_FORM = re.compile(rf"(?P<test>.+):(?P<low>{_NUMBER})?\.\.(?P<high>{_NUMBER})?\s*(?P<unit>\D*)")
_REMEDY = "write --use 'TEST:0..18mm' for its part to a displacement, 'TEST:0..12s' to a time"
_KINDS = {**{kind: kind for kind in KINDS}, **{name: kind for kind, name in NAMES.items()}}
_PHASE = re.compile(rf"(?P<test>.+):\s*(?P<kind>{'|'.join(_KINDS)})(?:\s+(?P<number>\d+))?")
_OPTION = "--leave-out"
_TO_LEAVE_OUT = (
    f"write {_OPTION} 'TEST:30..45s' for a time, 'TEST:0..0.1mm' for a displacement, "
    "'TEST:hold 2' for a phase"
)
_COLUMN = "the column use"
_NAMED = 3  # spans of time that are named


@dataclass(frozen=True)
class OfTest:
    """Text of the command line that concerns one test."""

    test: str
    text: str

    def names(self, test: Test) -> bool:
        """Return whether it is of this test, by the test's name or PAD/TEST."""
        return self.test in (test.name, f"{test.pad}/{test.name}")


@dataclass(frozen=True)
class SpanOfTest(OfTest):
    """The part of a test from low to high, in time (s) or displacement (``unit``)."""

    low: float
    high: float
    unit: str
    # option, remedy: of the command line, for messages
    option: str = "--use"
    remedy: str = _REMEDY

    @classmethod
    def from_text(cls, text: str, option: str = "--use", remedy: str = _REMEDY) -> Self:
        """Read ``TEST:0..18mm``; raise InputError if the text has another form."""
        match = _FORM.fullmatch(text.strip())
        units = (*SUFFIXES["time"], *SUFFIXES["displacement"], "")
        if match is None or match["unit"].strip() not in units:
            raise InputError(f"{option} {text!r} is no part of a test", remedy=remedy)
        low = -np.inf if match["low"] is None else float(match["low"])
        high = np.inf if match["high"] is None else float(match["high"])
        if not low < high:
            raise InputError(f"{option} {text!r} goes from {low:g} to {high:g}", remedy=remedy)
        return cls(match["test"].strip(), text, low, high, match["unit"].strip(), option, remedy)

    def values(self, test: Test, pad: Pad, begun: float = 0.0) -> NDArray[np.float64]:
        """Return the times or displacements (n,) of a test in the part's unit."""
        if self.unit in SUFFIXES["time"]:
            scale = SUFFIXES["time"][self.unit]
            return (test.time + begun) * scale.down / scale.up
        return test.displacement * self._factor(pad)

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
        part = slice(first, last)
        begin = float(test.time[first]) if first else 0.0
        return replace(
            test,
            time=test.time[part] - begin,
            displacement=test.displacement[part],
            force=test.force[part],
            force_sd=None if test.force_sd is None else test.force_sd[part],
            used=None if test.used is None else test.used[part],
            anew=None if test.anew is None else test.anew[part],
            start_s=test.start_s + begin,
            changes=tuple(
                replace(one, start=one.start - begin, stop=one.stop - begin) for one in test.changes
            ),
        )

    def _factor(self, pad: Pad) -> float:
        """Return the factor from the pad's unit of displacement to the cut's unit."""
        own = pad.units.displacement
        if not self.unit:
            return 1.0
        if pad.units.dimensionless:
            what = f"{self.option} {self.text!r}: pad {pad.name} has strain"
            raise InputError(what, remedy=self.remedy)
        ratio = SUFFIXES["displacement"][own].over(SUFFIXES["displacement"][self.unit])
        return ratio.up / ratio.down


def cut(pad: Pad, use: Sequence[str]) -> tuple[Pad, tuple[str, ...]]:
    """Return a pad with the selected parts of its tests, and a sentence on each cut."""
    tests, notices = list(pad.tests), []
    for one in map(SpanOfTest.from_text, use):
        for k, test in enumerate(tests):
            if not one.names(test):
                continue
            tests[k] = one.of_test(test, pad)
            left = len(test.time) - len(tests[k].time)
            notices.append(
                f"pad {pad.name}: of test {test.name} {len(tests[k].time)} rows are used, "
                f"as stated by {one.text}, and {left} left out"
            )
    return replace(pad, tests=tuple(tests)), tuple(notices)


@dataclass(frozen=True)
class NamedPhase(OfTest):
    """The number-th phase of a kind in a test, from 1 in order of time; None: all of them."""

    kind: str
    number: int | None

    @classmethod
    def from_text(cls, text: str) -> Self | None:
        """Read ``TEST:hold 2``; return None if the text has another form."""
        match = _PHASE.fullmatch(text.strip())
        if match is None:
            return None
        number = None if match["number"] is None else int(match["number"])
        return cls(match["test"].strip(), text, _KINDS[match["kind"]], number)

    def of_test(self, test: Test, phases: Sequence[Phase]) -> Mask:
        """Return which readings (n,) lie in the phase; raise InputError where there is none."""
        seen, chosen = Counter[str](), np.zeros(len(phases), dtype=bool)
        for k, phase in enumerate(phases):
            seen[phase.kind] += 1
            chosen[k] = phase.kind == self.kind and self.number in (None, seen[phase.kind])
        if not chosen.any():
            there = [f"{kind} 1 to {n}" if n > 1 else f"{kind} 1" for kind, n in seen.items()]
            raise InputError(
                f"{_OPTION} {self.text!r}: test '{test.name}' has no such phase",
                remedy=f"name one of {', '.join(there)}, or a time as 'TEST:30..45s'",
            )
        return np.asarray(chosen[phase_index(phases, test.time)])


@dataclass(frozen=True, eq=False)
class Excluded:
    """Readings of a test whose force is left out (n,), and what says so."""

    mask: Mask
    stated_by: str


def parts_of(leave_out: Iterable[str]) -> list[SpanOfTest | NamedPhase]:
    """Read ``TEST:30..45s`` and ``TEST:hold 2``; raise InputError for any other form."""
    return [
        NamedPhase.from_text(text) or SpanOfTest.from_text(text, _OPTION, _TO_LEAVE_OUT)
        for text in leave_out
    ]


def refuse_unknown(pads: Sequence[Pad], use: Sequence[str], leave_out: Sequence[str] = ()) -> None:
    """Raise InputError if a text names a test that no pad has, or cannot be read."""
    known = arguments_of(pads, use, leave_out)
    for option, one in _options_of(use, leave_out):
        if one.text not in known:
            names = ", ".join(dict.fromkeys(test.name for pad in pads for test in pad.tests))
            raise InputError(f"{option}: no test '{one.test}'", remedy=f"name one of {names[:200]}")


def arguments_of(pads: Sequence[Pad], use: Sequence[str], leave_out: Sequence[str]) -> list[str]:
    """Return the arguments of a command that say of these pads what counts."""
    tests = [test for pad in pads for test in pad.tests]
    return [
        word
        for option, one in _options_of(use, leave_out)
        if any(one.names(test) for test in tests)
        for word in (option, one.text)
    ]


def _options_of(use: Sequence[str], leave_out: Sequence[str]) -> list[tuple[str, OfTest]]:
    return [
        *(("--use", SpanOfTest.from_text(text)) for text in use),
        *((_OPTION, part) for part in parts_of(leave_out)),
    ]


def excluded_readings(
    test: Test,
    pad: Pad,
    leave_out: Sequence[str],
    *,
    begun: float = 0.0,
    phases: Sequence[Phase] | None = None,
) -> tuple[Excluded, ...]:
    """Return the readings of a test whose force the user leaves out, by whatever says so."""
    excluded = [] if test.used is None else [Excluded(~test.used, _COLUMN)]
    for one in parts_of(leave_out):
        if not one.names(test):
            continue
        if isinstance(one, SpanOfTest):
            values = one.values(test, pad, begun)
            mask = (values >= one.low) & (values <= one.high)
        elif phases is not None:
            mask = one.of_test(test, phases)
        else:
            continue
        if not mask.any():
            what = f"{_OPTION} {one.text!r}: test '{test.name}' has no reading there"
            raise InputError(what, remedy=_TO_LEAVE_OUT)
        excluded.append(Excluded(mask, f"{_OPTION} {one.text}"))
    left = int(np.count_nonzero(~excluded_by_any(test, excluded)))
    if left < LEAST_SAMPLES:
        raise InputError(
            f"of the readings of test '{test.name}' of pad '{test.pad}' {left} are left, and at "
            f"least {LEAST_SAMPLES} are needed",
            remedy="leave out less, or delete the test",
        )
    return tuple(excluded)


def excluded_by_any(test: Test, excluded: Iterable[Excluded]) -> Mask:
    """Return the readings (n,) of a test that are left out by any of these."""
    mask = np.zeros(test.time.size, dtype=bool)
    for one in excluded:
        mask |= one.mask
    return mask


def marked(test: Test, excluded: Iterable[Excluded]) -> Test:
    """Return a test that says which of its readings of force are used."""
    mask = excluded_by_any(test, excluded)
    return replace(test, used=~mask if mask.any() else None)


def left_out_of(
    test: Test, bad: BadReadings | None, excluded: Iterable[Excluded]
) -> BadReadings | None:
    """Return all readings of a test that are left out, bad ones and excluded ones; else None."""
    runs = [] if bad is None else list(bad.runs)
    taken = np.zeros(test.time.size, dtype=bool) if bad is None else bad.mask.copy()
    for one in excluded:
        runs += [
            Bad(*run, "force", "excluded", one.stated_by) for run in runs_of(one.mask & ~taken)
        ]
        taken |= one.mask
    if not runs:
        return None
    return BadReadings.from_runs(test.time, test.displacement, test.force, runs)


def excluded_notices(
    pad: str, tests: Sequence[tuple[str, BadReadings | None]], units: UnitSystem
) -> tuple[str, ...]:
    """Return a sentence on the readings of each test that the user leaves out, by what says so."""
    sentences = []
    for name, bad in tests:
        if bad is None:
            continue
        runs: dict[str, list[Bad]] = {}
        for run in bad.runs:
            if run.kind == "excluded":
                runs.setdefault(run.stated_by, []).append(run)
        for stated_by, own in runs.items():
            count = sum(run.stop - run.first for run in own)
            readings = "one reading" if count == 1 else f"{count} readings"
            sentences.append(
                f"pad {pad}: of test {name} the {units.force_name} of {readings} is left out "
                f"({_times(bad, own)}), as stated by {stated_by}; their {units.displacement_name} "
                "still counts, as the specimen remembers it"
            )
    return tuple(sentences)


def _times(bad: BadReadings, runs: Sequence[Bad]) -> str:
    """Return when runs of readings were, as '30 to 45 s and 60 to 61 s'."""
    spans: list[tuple[int, int]] = []
    for run in runs:
        if spans and bad.mask[spans[-1][1] : run.first].all():  # but for bad readings it goes on
            spans[-1] = (spans[-1][0], run.stop)
        else:
            spans.append((run.first, run.stop))
    at = np.cumsum(bad.mask) - 1  # of a reading of the test, in those that are left out
    named = [
        " to ".join(dict.fromkeys(plain(float(bad.time[at[k]]), 6) for k in (first, stop - 1)))
        for first, stop in spans[:_NAMED]
    ]
    more = len(spans) - len(named)
    others = [f"{more} other span{'s' if more > 1 else ''}"] if more else []
    return joined([*(f"{one} s" for one in named), *others])
