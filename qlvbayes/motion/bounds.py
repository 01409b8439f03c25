"""Bounds on the residuals of a fitted motion, of single readings and of runs of neighbours.

The mean of m neighbours scatters by 1 / sqrt(m): what is too small to be seen in one reading shows
in a run of them (the scan statistic; Glaz, Naus & Wallenstein 2001). Runs have 2, 4, 8, ...
readings; their means may be off by half a step of the encoder and what scatter leaves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.io.wording import plain

_UNSEEN = 0.3  # of the bound on each residual: their root mean square in an exact record
_RESOLUTIONS = 2.0  # as far from its readings as a motion may be, but for their scatter
_TINY = 1e-300  # for a platen that never moves


@dataclass(frozen=True)
class Tolerance:
    """Largest residuals of a motion that agrees with its readings, in units of displacement.

    ``sample`` bounds each residual, ``rest`` the half-range of readings at rest; with sensor noise
    above the encoder step (``noise`` > 0, its sd) the means of runs of readings are bounded as
    well. ``spread``: as far as scatter takes one reading of all; ``floor``: what no record is
    asked to be better than; ``step``: the encoder's.
    """

    sample: float
    rest: float
    spread: float
    floor: float
    noise: float
    step: float

    @property
    def farthest(self) -> float:
        """Largest distance of a path from a reading: two resolutions, or more with noise."""
        return max(2.0 * self.step, 2.0 * self.noise, 1.25 * max(self.sample, self.rest))

    @property
    def variance(self) -> float:
        """Variance of a reading's error, from rounding and scatter."""
        known = self.step**2 / 12.0 + self.noise**2
        return max(known, (_UNSEEN * self.sample) ** 2 if known == 0.0 else 0.0)

    @property
    def resolution(self) -> float:
        """Largest of the encoder step, the scatter's sd and the floor."""
        return max(self.step, self.noise, self.floor)

    def run(self, length: int) -> float:
        """Return the largest allowed mean of this many neighbouring residuals."""
        return max(0.5 * self.step + self.spread / float(np.sqrt(length)), self.floor)


def excess(residual: Array, tol: Tolerance, alone: float, common: float = 0.0) -> Array:
    """Return the residual (n,) of each reading, or of a run around it, over its bound."""
    ratio = np.abs(residual) / max(alone, _TINY)
    for length, means in runs(residual, tol):
        middle = ratio[length // 2 : length // 2 + means.size]
        np.maximum(middle, means / (tol.run(length) + common), out=middle)
    return ratio


def runs(residual: Array, tol: Tolerance) -> Iterator[tuple[int, Array]]:
    """Yield the lengths m = 2, 4, 8, ... with the absolute means (n - m + 1,) of m neighbours."""
    if tol.noise == 0.0:
        return
    sums = np.concatenate([[0.0], np.cumsum(residual)])
    length = 2
    while length <= residual.size:
        yield length, np.abs(sums[length:] - sums[:-length]) / length
        length *= 2


@dataclass(frozen=True)
class Departure:
    """The largest deviation of a motion from its readings, beyond what their errors explain."""

    time: float
    # distance, explained: in units of displacement, of the mean of so many neighbouring
    # ``readings`` about that time
    distance: float
    explained: float
    readings: int = 1

    def notice(self, test: str, unit: str) -> str:
        """Describe the deviation in a sentence."""
        those = "reading" if self.readings == 1 else f"mean of {self.readings} readings"
        return (
            f"test {test}: the fitted motion is {plain(self.distance)} {unit} from the {those} at "
            f"{self.time:.6g} s, where scatter and resolution explain "
            f"{plain(self.explained, 2)} {unit}; "
            "see whether readings there are wrong"
        )


def departure_of(time: Array, residual: Array, tol: Tolerance) -> Departure | None:
    """Return the largest deviation of a path from its readings; None if none is significant."""
    least = _RESOLUTIONS * tol.resolution
    alone = np.where(np.isfinite(residual), np.abs(residual), np.inf)
    scans = [(1, alone, max(least, tol.sample, tol.rest))]
    scans += [(m, means, max(least, tol.run(m))) for m, means in runs(residual, tol)]
    beyond = [(float(sizes.max()) - most) / max(most, _TINY) for _, sizes, most in scans]
    length, sizes, most = scans[int(np.argmax(beyond))]
    worst = int(np.argmax(sizes))
    if sizes[worst] <= most:
        return None
    return Departure(float(time[worst + length // 2]), float(sizes[worst]), most, length)
