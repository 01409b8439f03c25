"""Dwells and segments of a displacement record, and the scatter of its readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import ndtri

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance, excess

_FIT_SAMPLES = 200  # a quadratic needs no more samples than this
_FEWEST_IN_DWELL = 5
_ROUNDING = 1e-9  # a range of two whole steps is motion, however the file's unit rounds them
_MANY = 100  # readings that distinguish scatter from motion,
_FEW = 50  # readings, of which three changes of the motion reach a third,
_SHOWING = 50_000  # and that show it to a third of a per cent
_REPEATS = 0.3  # of a step: sd of the scatter with which six readings repeat in half of all cases
_STILL = 0.02  # of the windows repeat exactly: seldom for scatter of a step, more for a smaller one
_QUIET, _QUIETEST = 0.7, 0.3  # of the windows, from the quietest on, of many readings and of few
_SMALL = 2.0  # steps: larger changes are motion
_UNDONE = 8  # changes undone that show a scatter
_MOSTLY = 0.3  # of the pairs of small changes,
_OFTEN = 0.1  # or so many of them
_AT_ONCE = 2  # readings later at most
_PER_KNOT = 2.5  # numbers that a path takes from the readings for each of its knots


def known_scatter(
    times: Sequence[Array], displacements: Sequence[Array], steps: Sequence[float]
) -> list[float]:
    """Return upper bounds on the scatter's sd in several records by one sensor."""
    few = [time.size < _MANY for time in times]
    if not any(few):
        return [np.inf] * len(few)
    records = zip(times, displacements, steps, few, strict=True)
    least = min(
        (_scatter(t, x, step) for t, x, step, short in records if not short), default=np.inf
    )
    return [least if short else np.inf for short in few]


def sensor_noise(time: Array, signal: Array, step: float = 0.0) -> float:
    """Return a robust sd of the scatter about local polynomials beyond rounding to ``step``."""
    best, most = np.inf, np.inf
    shares = (_QUIET, _QUIETEST) if time.size < _FEW else (_QUIET,)
    for points in (3, 4, 5, 6):
        if time.size < points + 6:
            break
        windows = np.lib.stride_tricks.sliding_window_view(signal, points)
        weights = _divided_difference(np.lib.stride_tricks.sliding_window_view(time, points))
        moving = np.ptp(windows, axis=1) > 0.0
        if np.count_nonzero(moving) < 6:
            return 0.0
        still = 1.0 - np.count_nonzero(moving) / moving.size
        if still > 0.5:
            most = _REPEATS * step
        elif still > _STILL and step > 0.0:
            most = min(most, step)
        size = np.abs(np.sum(windows * weights, axis=1)[moving])
        rounding = 0.501 * step * np.abs(weights[moving]).sum(axis=1)
        beyond = int(np.count_nonzero(size > rounding))
        if step > 0.0 and beyond <= min(10, 0.05 * size.size) + 0.005 * size.size:
            return 0.0
        best = min(best, *(_trimmed_sd(size, share) for share in shares))
    if not np.isfinite(best):
        return 0.0
    return float(np.sqrt(max(min(best, most) ** 2 - step**2 / 12.0, 0.0)))


def _trimmed_sd(size: Array, share: float) -> float:
    """Return the Gaussian sd from a share of the values with the smallest magnitudes."""
    kept = np.sort(size)[: max(1, int(share * size.size))]
    most = float(ndtri(0.5 + 0.5 * share))
    density = np.exp(-0.5 * most**2) / np.sqrt(2.0 * np.pi)
    return float(np.sqrt(np.mean(kept**2) / (1.0 - 2.0 * most * density / share)))


def _divided_difference(times: Array) -> Array:
    """Return weights (rows of unit norm) that annihilate polynomials of degree points - 2."""
    gaps = times[:, :, None] - times[:, None, :]
    gaps /= np.ptp(times, axis=1)[:, None, None]
    gaps[:, np.arange(times.shape[1]), np.arange(times.shape[1])] = 1.0
    weights = 1.0 / np.prod(gaps, axis=2)
    return np.asarray(weights / np.linalg.norm(weights, axis=1, keepdims=True), dtype=np.float64)


def tolerance(time: Array, displacement: Array, step: float, scatter: float = np.inf) -> Tolerance:
    """Return the bounds that step and scatter imply, at least 1e-4 of the range."""
    span = float(np.ptp(displacement))
    floor = 1e-4 * span
    noise = min(_scatter(time, displacement, step), scatter)
    if noise <= 0.1 * floor:
        noise = 0.0
    spread = float(1.0 + np.sqrt(2.0 * np.log(max(time.size, 2)))) * noise
    if time.size < _MANY:
        spread = min(spread, 0.05 * span)
    return Tolerance(
        sample=max(0.75 * step, 0.5 * step + spread, floor),
        rest=max(step, 0.5 * step + spread, floor),
        spread=spread,
        floor=floor,
        noise=noise,
        step=step,
    )


def _scatter(time: Array, displacement: Array, step: float) -> float:
    """Return the scatter of as many readings as determine it, to limit memory."""
    x = displacement[:_SHOWING]
    return max(sensor_noise(time[:_SHOWING], x, step), dither(x, step))


def scatter_left(residual: Array, displacement: Array, knots: int, tol: Tolerance) -> float:
    """Return the sd of the scatter about a fitted path; infinite where it is not determined."""
    freedom = residual.size - _PER_KNOT * knots
    if tol.noise == 0.0 or freedom < 0.5 * residual.size:
        return np.inf
    size = np.abs(residual)
    left = min(_trimmed_sd(size, _QUIET), float(np.sqrt(np.mean(size**2))))
    left *= float(np.sqrt(residual.size / freedom))
    beyond = float(np.sqrt(max(left**2 - tol.step**2 / 12.0, 0.0)))
    return max(beyond, dither(displacement, tol.step))


def dither(displacement: Array, step: float) -> float:
    """Return the sd of a scatter that moves readings to and fro by a step or two; 0 if none."""
    if step == 0.0:
        return 0.0
    change = np.round(np.diff(displacement) / step)
    small = np.abs(change) <= _SMALL
    moves = np.flatnonzero(change != 0.0)
    pairs = small[moves[1:]] & small[moves[:-1]]
    back = pairs & (change[moves[1:]] * change[moves[:-1]] < 0.0)
    undone, of = np.count_nonzero(back), np.count_nonzero(pairs)
    at_once = np.count_nonzero(back & (np.diff(moves) <= _AT_ONCE))
    if undone < _UNDONE or (undone < _MOSTLY * of and at_once < _OFTEN * of):
        return 0.0
    among = small[1:] & small[:-1]
    variance = float(np.mean(np.diff(change)[among] ** 2)) / 6.0
    if variance < 0.25:
        return step * 0.5 / -float(ndtri(0.5 * variance))
    return step * float(np.sqrt(variance - 1.0 / 12.0))


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
    speed = [_speed(time, displacement, s) for s in segments]
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
    stretched = _stretched(displacement, _distinct(dwells, tol), tol)
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


def _speed(time: Array, displacement: Array, segment: tuple[int, int]) -> float:
    first, stop = segment
    if stop - first < 2:
        return 0.0
    return abs(float(displacement[stop - 1] - displacement[first])) / float(
        time[stop - 1] - time[first]
    )


def _distinct(dwells: list[DwellSpan], tol: Tolerance) -> list[DwellSpan]:
    """Leave out touching dwells of nearly one level, which are a creep."""
    creeping = {
        r
        for a, b in pairwise(dwells)
        if b.first - a.stop < 3 and abs(a.level - b.level) < 4.0 * tol.rest
        for r in (a, b)
    }
    return [r for r in dwells if r not in creeping]


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
