"""Readings of force that the user leaves out, by a column of the file or by name.

The displacement of these readings stays: the specimen remembers what was done to it there. Only
their force does not count, in the fit as in all that is measured from the readings.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from qlvbayes.io.arrays import Mask
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.reading.testchecks import LEAST_SAMPLES
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import joined, plain
from qlvbayes.motion.badreadings import Bad, BadReadings, runs_of
from qlvbayes.motion.cutting import OfTest, SpanOfTest
from qlvbayes.motion.phases import KINDS, NAMES, Phase, phase_index

_KINDS = {**{kind: kind for kind in KINDS}, **{name: kind for kind, name in NAMES.items()}}
_PHASE = re.compile(rf"(?P<test>.+):\s*(?P<kind>{'|'.join(_KINDS)})(?:\s+(?P<number>\d+))?")
_OPTION = "--leave-out"
_REMEDY = (
    f"write {_OPTION} 'TEST:30..45s' for a time, 'TEST:0..0.1mm' for a displacement, "
    "'TEST:hold 2' for a phase"
)
_COLUMN = "the column use"
_NAMED = 3  # spans of time that are named


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
        NamedPhase.from_text(text) or SpanOfTest.from_text(text, _OPTION, _REMEDY)
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
            raise InputError(what, remedy=_REMEDY)
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
