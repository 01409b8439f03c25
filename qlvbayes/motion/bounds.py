"""Bounds on the residuals of a motion, and the dwells and segments of a record within them.

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
_FIT_SAMPLES = 200  # a quadratic needs no more samples than this
_FEWEST_IN_DWELL = 5
_ROUNDING = 1e-9  # a range of two whole steps is motion, however the file's unit rounds them


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


def _quadratic_fits(time: Array, x: Array, tol: Tolerance) -> bool:
    n = time.size
    if n <= 3:
        return True
    half = 0.5 * (time[-1] - time[0])
    u = (time - time[0]) / half - 1.0
    level = float(x.max() - x.min()) < 2.0 * tol.rest * (1.0 - _ROUNDING)
    if level and _about_zero(x - float(x.mean()), tol):
        return True
    v, y = _fewer(u, x, tol)
    design = np.stack([np.ones_like(v), v, v * v])
    a, b, c = np.linalg.solve(design @ design.T, design @ (y - x[0]))
    residual = x - x[0] - (a + u * (b + u * c))
    if float(np.abs(residual).max()) > tol.sample and float(np.ptp(residual)) > 1.25 * tol.step:
        return False  # a curve parallel to the fitted one may yet round to every reading
    return _about_zero(residual, tol)


def _fewer(u: Array, x: Array, tol: Tolerance) -> tuple[Array, Array]:
    """Return at most a few hundred samples; where they scatter, means of all of them."""
    if u.size <= _FIT_SAMPLES:
        return u, x
    if tol.noise == 0.0:
        pick = np.linspace(0, u.size - 1, _FIT_SAMPLES).astype(int)
        return u[pick], x[pick]
    first = np.linspace(0, u.size, _FIT_SAMPLES + 1).astype(int)
    count = np.diff(first)
    return np.add.reduceat(u, first[:-1]) / count, np.add.reduceat(x, first[:-1]) / count


def _about_zero(residual: Array, tol: Tolerance) -> bool:
    """Return whether means of neighbours are zero within their errors."""
    alone = tol.rest if tol.noise > 0.0 else np.inf
    return bool(np.max(excess(residual, tol, alone)) <= 1.0)


def greedy_segments(time: Array, displacement: Array, tol: Tolerance) -> list[tuple[int, int]]:
    """Cut a record into the longest runs of samples [i, j) that one quadratic follows."""
    segments: list[tuple[int, int]] = []
    start, n = 0, time.size
    while start < n:
        good, reach = min(start + 3, n), 8
        bad = n + 1
        while good < n:
            stop = min(start + reach, n)
            if not _quadratic_fits(time[start:stop], displacement[start:stop], tol):
                bad = stop
                break
            good, reach = stop, 2 * reach
        while bad - good > 1 and bad <= n:
            middle = (good + bad) // 2
            if _quadratic_fits(time[start:middle], displacement[start:middle], tol):
                good = middle
            else:
                bad = middle
        segments.append((start, good))
        start = good
    return segments


@dataclass(frozen=True)
class DwellSpan:
    """Samples [first, stop) at one level."""

    first: int
    stop: int
    level: float


def find_dwells(
    time: Array, displacement: Array, segments: list[tuple[int, int]], tol: Tolerance
) -> list[DwellSpan]:
    """Return the runs of samples at rest, each stretched as far as its level reaches."""
    rests = []
    for k, segment in enumerate(segments):
        first, stop = _longest_rest(displacement, *segment, tol)
        x = displacement[first:stop]
        if stop - first < _FEWEST_IN_DWELL or np.ptp(x) >= 2.0 * tol.rest * (1.0 - _ROUNDING):
            continue
        if _about_zero(x - x.mean(), tol):
            rests.append(_Rest(first, stop, k, k))
    ends = np.array(segments) - np.array([0, 1])  # first and last reading of each
    ways = np.abs(np.diff(displacement[ends], axis=1))[:, 0]
    lengths = np.diff(time[ends], axis=1)[:, 0]
    speed = np.divide(ways, lengths, out=np.zeros(ways.size), where=lengths > 0.0)
    dwells = []
    for rest in _joined(displacement, rests, tol):
        neighbouring = max(
            speed[max(rest.low - 1, 0)], speed[min(rest.high + 1, len(segments) - 1)]
        )
        alone = rest.low == 0 and rest.high == len(segments) - 1
        # At the speed next door it would have been seen to move.
        if alone or neighbouring * (time[rest.stop - 1] - time[rest.first]) >= 4.0 * tol.rest:
            level = float(displacement[rest.first : rest.stop].mean())
            dwells.append(DwellSpan(rest.first, rest.stop, level))
    stretched = _stretched(displacement, dwells, tol)
    return [dwell for dwell in stretched if not _turns(time, displacement, dwell, tol)]


@dataclass(frozen=True)
class _Rest:
    """Samples [first, stop) that may be at rest, of the segments from ``low`` to ``high``."""

    first: int
    stop: int
    low: int
    high: int


def _longest_rest(displacement: Array, begin: int, end: int, tol: Tolerance) -> tuple[int, int]:
    """Return a segment, or where it scatters the longest run of readings about its median."""
    if tol.noise == 0.0:
        return begin, end
    x = displacement[begin:end]
    off = np.flatnonzero(excess(x - float(np.median(x)), tol, tol.rest) > 1.0)
    edges = np.concatenate([[-1], off, [x.size]])
    longest = int(np.argmax(np.diff(edges)))
    return begin + int(edges[longest]) + 1, begin + int(edges[longest + 1])


def _joined(displacement: Array, rests: list[_Rest], tol: Tolerance) -> list[_Rest]:
    """Join rests that scatter alone has divided: they share one level."""
    out: list[_Rest] = []
    for rest in rests:
        out.append(rest)
        while tol.noise > 0.0 and len(out) > 1:
            before, after = out[-2:]
            x = displacement[before.first : after.stop]
            if not _about_zero(x - x.mean(), tol):
                break
            out[-2:] = [_Rest(before.first, after.stop, before.low, after.high)]
    return out


def _turns(time: Array, displacement: Array, dwell: DwellSpan, tol: Tolerance) -> bool:
    """Return whether one parabola fits the dwell and twice its length on either side."""
    reach = 2 * (dwell.stop - dwell.first)
    around = slice(max(dwell.first - reach, 0), dwell.stop + reach)
    x = displacement[around]
    if x.size < 2 * (dwell.stop - dwell.first):
        return False
    return float(np.ptp(x)) > 4.0 * tol.rest and _quadratic_fits(time[around], x, tol)


def _stretched(displacement: Array, dwells: list[DwellSpan], tol: Tolerance) -> list[DwellSpan]:
    out: list[DwellSpan] = []
    for k, dwell in enumerate(dwells):
        low = out[-1].stop if out else 0
        high = dwells[k + 1].first if k + 1 < len(dwells) else displacement.size
        level_error = tol.spread / float(np.sqrt(dwell.stop - dwell.first))
        off = displacement[low:high] - dwell.level
        near = excess(off, tol, tol.sample, level_error) <= 1.0
        before = np.flatnonzero(~near[: dwell.first - low])
        after = np.flatnonzero(~near[dwell.stop - low :])
        first = low + int(before[-1]) + 1 if before.size else low
        stop = dwell.stop + int(after[0]) if after.size else high
        out.append(DwellSpan(first, stop, float(displacement[first:stop].mean())))
    return out
