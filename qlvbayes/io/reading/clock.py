"""Find single wrong time stamps amid even sampling: they repeat, run ahead or fall behind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array as Floats

_AROUND = 8  # steps on either side of a slip, from which the clock's step is taken
_EVEN = 0.2  # deviation from the median step, over it, up to which a step counts as even
_MOST_UNEVEN = 0.3  # share of these steps that may be uneven: the slip's own, and jitter
_LEFT = 2.5  # largest gap, in median steps, between the neighbours of a reading left out
LARGEST_SHARE = 0.02  # share of a test's readings that may be bad; with more it is not reliable


def slipped(time: Floats) -> NDArray[np.intp] | None:
    """Return which stamps (k,) must go so that time increases, or None."""
    falls = np.flatnonzero(np.diff(time) <= 0.0) + 1
    if falls.size > LARGEST_SHARE * time.size:
        return None
    indices: list[int] = []
    for fall in falls.tolist():
        index = _slip(time, fall)
        if index is None:
            return None
        indices.append(index)
    slips = np.unique(np.array(indices, dtype=np.intp))
    return slips if np.all(np.diff(np.delete(time, slips)) > 0.0) else None


def _slip(time: Floats, fall: int) -> int | None:
    """Return the stamp at a fall, or the one before it, without which time goes on evenly."""
    around = np.diff(time[max(fall - 1 - _AROUND, 0) : fall + 1 + _AROUND])
    step = float(np.median(around))
    uneven = np.abs(around - step) > _EVEN * step
    if step <= 0.0 or np.mean(uneven) > _MOST_UNEVEN:
        return None
    for at in (fall, fall - 1):
        if at in (0, time.size - 1):
            return at
        if 0.0 < time[at + 1] - time[at - 1] <= _LEFT * step:
            return at
    return None
