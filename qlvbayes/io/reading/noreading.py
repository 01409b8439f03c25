"""Find numbers that are no readings: not finite, or a logger's code for a missing one."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array as Floats

LARGEST = 1e20
"""Largest number that is a reading of any channel, in any unit; beyond it is a code or an error."""
SMALLEST = 1e-30
"""Smallest share of a channel's largest reading: squares of smaller readings underflow."""
SHORTEST = 1e-9
"""Shortest duration (s) of a whole test: no channel is sampled as fast as that."""
_DIGITS = 1e-5  # of the largest value, in which readings may differ that are the same
_CODE = re.compile(r"-?(99+(\.9+)?|999\.25|32768|2147483648)")
"""Nines alone (-999, 9999.9), the code of well logs, and the last numbers of two and four bytes."""
_SHOWN = 12  # digits that are compared; rounding of a unit's factor is beyond
_MOST_KINDS = 20  # different numbers checked, the farthest away first: a code is one number


@dataclass(frozen=True, eq=False)
class NoReading:
    """Rows (rows,) in which a channel has no reading, and the codes that stand there."""

    rows: NDArray[np.bool_]
    codes: tuple[float, ...]

    @property
    def count(self) -> int:
        """Return the number of rows."""
        return int(np.count_nonzero(self.rows))

    @property
    def written(self) -> str:
        """Return the codes as text for a message: '-999', '-999 and -9999'."""
        return " and ".join(f"{code:.{_SHOWN}g}" for code in self.codes[:3])


def no_readings(values: Floats, *, coded: bool = True) -> NoReading:
    """Return the rows whose number is not finite, too large to be measured, or a code."""
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
    """Return numbers that lie off all others by more than these span, the farthest first."""
    distant: list[float] = []
    different = np.unique(values)
    while len(different) > 2 and len(distant) < _MOST_KINDS:
        low, high = float(different[1] - different[0]), float(different[-1] - different[-2])
        first = low > high
        rest = different[1:] if first else different[:-1]
        if max(low, high) <= float(rest[-1] - rest[0]):
            break
        distant.append(float(different[0] if first else different[-1]))
        different = rest
    return distant


def out_of_range(time: Floats, channels: dict[str, Floats]) -> str | None:
    """Return what no rig measures, as text; None where all numbers can be used."""
    if not SHORTEST <= float(time[-1] - time[0]) <= LARGEST:
        return f"the test lasts {float(time[-1] - time[0]):.3g} s"
    for name, values in channels.items():
        if (largest := float(np.abs(values).max())) < SMALLEST:
            return f"{name} is {largest:.3g} at most"
    return None


def same_readings(one: Floats, other: Floats, *, rounded: bool) -> bool:
    """Return whether values are equal, or round to each other where they had different units."""
    size = max(float(np.abs(one).max()), float(np.abs(other).max()))
    digits = sum(_resolution(values, size) for values in (one, other)) if rounded else 0.0
    return bool(np.abs(one - other).max() <= 0.51 * digits + _DIGITS * size)


def _resolution(values: Floats, size: float) -> float:
    """Return the smallest step between different values, 0 where they are all equal."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > _DIGITS * size]
    return float(steps.min()) if steps.size else 0.0
