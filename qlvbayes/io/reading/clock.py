"""Single time stamps that slipped amid even sampling: they repeat, run ahead or fall behind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_AROUND = 8  # gaps on either side of a slip that say how the clock ticks
_EVEN = 0.2  # of the usual gap: so far from it one still counts as even
_MOST_UNEVEN = 0.3  # of these gaps may be uneven: the slip's own, and a logger's jitter
_LEFT = 2.5  # usual gaps: what a reading left out may leave between its neighbours
LARGEST_SHARE = 0.02  # of a test's readings that may be bad; with more it is not to be trusted


def slipped(time: Floats) -> NDArray[np.intp] | None:
    """Which stamps (k,) must go so that time increases; None where that is more than single slips.

    At most 2 % may, each between stamps that increase evenly.
    """
    falls = np.flatnonzero(np.diff(time) <= 0.0) + 1
    if falls.size > LARGEST_SHARE * time.size:
        return None
    found: list[int] = []
    for fall in falls.tolist():
        at = _slip(time, fall)
        if at is None:
            return None
        found.append(at)
    slips = np.unique(np.array(found, dtype=np.intp))
    return slips if np.all(np.diff(np.delete(time, slips)) > 0.0) else None


def _slip(time: Floats, fall: int) -> int | None:
    """The stamp at a fall, or the one before it, without which time goes on evenly."""
    around = np.diff(time[max(fall - 1 - _AROUND, 0) : fall + 1 + _AROUND])
    usual = float(np.median(around))
    uneven = np.abs(around - usual) > _EVEN * usual
    if usual <= 0.0 or np.mean(uneven) > _MOST_UNEVEN:
        return None
    for at in (fall, fall - 1):
        if at in (0, time.size - 1):
            return at
        if 0.0 < time[at + 1] - time[at - 1] <= _LEFT * usual:
            return at
    return None
