"""Numbers that are no readings: not finite, or a code that a logger writes in place of one."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LARGEST = 1e20
"""Beyond what any channel measures, in any unit: a code, or a number read wrongly."""
SMALLEST = 1e-30
"""Of the largest reading of a channel: below it squares of readings are no numbers any more."""
SHORTEST = 1e-9
"""s, of a whole test: no channel is sampled as fast as that."""
_CODE = re.compile(r"-?(99+(\.9+)?|999\.25|32768|2147483648)")
"""Nines alone (-999, 9999.9), that of well logs, and the last numbers of two and four bytes."""
_SHOWN = 12  # digits by which a number is looked at; rounding of a unit's factor is beyond
_MOST_KINDS = 20  # different numbers looked at, the farthest away first: a code is one number


@dataclass(frozen=True, eq=False)
class NoReading:
    """Where a channel has no reading (rows,), and which codes stand there."""

    rows: NDArray[np.bool_]
    codes: tuple[float, ...]

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(np.count_nonzero(self.rows))

    @property
    def written(self) -> str:
        """The codes as a message has them: '-999', '-999 and -9999'."""
        return " and ".join(f"{code:.{_SHOWN}g}" for code in self.codes[:3])


def no_readings(values: Floats, *, coded: bool = True) -> NoReading:
    """Rows whose number is not finite, too large to be measured, or a code for no reading.

    A number that loggers use as a code is one where it lies off all other readings by more than
    they span: a displacement of -999 um on the way from 0 to -1200 um is a reading. coded: whether
    there may be such codes; a clock has none. Nor is what more than half of the rows have a code.
    """
    lost = ~(np.abs(values) < LARGEST)  # true of what is not finite too
    codes = set(values[lost & np.isfinite(values)].tolist())
    for code in _far_away(values[~lost]) if coded else ():
        here = values == code
        held = 2 * np.count_nonzero(here) > len(values)  # a step of 99 um, held
        if _CODE.fullmatch(f"{code:.{_SHOWN}g}") and not held:
            codes.add(code)
            lost |= here
    return NoReading(lost, tuple(sorted(codes, key=abs)))


def _far_away(values: Floats) -> list[float]:
    """Different numbers, the farthest from the middle first, while they are off all others."""
    found: list[float] = []
    different = np.unique(values)
    while len(different) > 2 and len(found) < _MOST_KINDS:
        low, high = float(different[1] - different[0]), float(different[-1] - different[-2])
        first = low > high
        rest = different[1:] if first else different[:-1]
        if max(low, high) <= float(rest[-1] - rest[0]):
            break
        found.append(float(different[0] if first else different[-1]))
        different = rest
    return found


def out_of_range(time: Floats, channels: dict[str, Floats]) -> str | None:
    """What no rig measures, in words; None where all can be reckoned with.

    channels: readings by name, none of them lost.
    """
    if not SHORTEST <= float(time[-1] - time[0]) <= LARGEST:
        return f"the test lasts {float(time[-1] - time[0]):.3g} s"
    for name, values in channels.items():
        if (largest := float(np.abs(values).max())) < SMALLEST:
            return f"{name} is {largest:.3g} at most"
    return None
