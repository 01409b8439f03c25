"""Selection of a part of a test, such as the part before the specimen tears."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.reading.testchecks import LEAST_SAMPLES
from qlvbayes.io.units import SUFFIXES

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_FORM = re.compile(rf"(?P<test>.+):(?P<low>{_NUMBER})?\.\.(?P<high>{_NUMBER})?\s*(?P<unit>\D*)")
_REMEDY = "write --use 'TEST:0..18mm' for its part to a displacement, 'TEST:0..12s' to a time"


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
