"""Where a fitted motion is not with its readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.preprocess.bounds import TINY, Tolerance, runs

Array = NDArray[np.float64]

_RESOLUTIONS = 2.0  # as far from its readings as a motion may be, but for their scatter


@dataclass(frozen=True)
class Departure:
    """Where a motion is farthest from its readings, beyond what their errors explain.

    time: s; distance, explained: in units of displacement, of the mean of so many neighbouring
    ``readings`` about that time.
    """

    time: float
    distance: float
    explained: float
    readings: int = 1

    def notice(self, test: str, unit: str) -> str:
        """In a sentence."""
        those = "reading" if self.readings == 1 else f"mean of {self.readings} readings"
        return (
            f"test {test}: the fitted motion is {self.distance:.3g} {unit} from the {those} at "
            f"{self.time:.6g} s, where scatter and resolution explain {self.explained:.2g} {unit}; "
            "see whether readings there are wrong"
        )


def departure_of(time: Array, residual: Array, tol: Tolerance) -> Departure | None:
    """Return where a path leaves its readings most; None where it is with all of them.

    residual (n,): readings at times (n,) in s less the path. Each reading is looked at, and each
    run of neighbours: its mean may be off by two resolutions, or by what rounding and scatter make
    of such a mean where that is more.
    """
    least = _RESOLUTIONS * tol.resolution
    alone = np.where(np.isfinite(residual), np.abs(residual), np.inf)
    found = [(1, alone, max(least, tol.sample, tol.rest))]
    found += [(m, means, max(least, tol.run(m))) for m, means in runs(residual, tol)]
    beyond = [(float(sizes.max()) - most) / max(most, TINY) for _, sizes, most in found]
    length, sizes, most = found[int(np.argmax(beyond))]
    worst = int(np.argmax(sizes))
    if sizes[worst] <= most:
        return None
    return Departure(float(time[worst + length // 2]), float(sizes[worst]), most, length)
