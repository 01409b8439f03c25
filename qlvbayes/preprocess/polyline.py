"""Straight lines through readings: a motion that is never far from them, whatever they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def corners(time: Array, displacement: Array, tolerance: float) -> NDArray[np.intp]:
    """Places of the readings that straight lines join so that none is farther off than a tolerance.

    Each stretch is divided at its farthest reading (Ramer 1972; Douglas and Peucker 1973).
    """
    kept = {0, time.size - 1}
    open_ends = [(0, time.size - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        t, x = time[first : last + 1], displacement[first : last + 1]
        line = x[0] + (x[-1] - x[0]) * (t - t[0]) / (t[-1] - t[0])
        off = np.abs(x - line)
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            kept.add(first + worst)
            open_ends += [(first, first + worst), (first + worst, last)]
    return np.array(sorted(kept))
