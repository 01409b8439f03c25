"""Measure readings of displacement: the encoder's step, their scatter, the clock's error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance

_LEAST_STEP = 1e-6  # of the range: finer rounding is no encoder's, nor has a record of seven digits
_LARGE = 0.02  # of the range: a step that a movement there and back passes a hundred times,
_PASSED = 20  # changes that show a larger one
_REPEATED = 3  # equal readings in a row: a level,
_LEVELS = 20  # of which so many, each next to another, show how far apart levels are
_WHOLE = 0.95  # of these distances are multiples of the median one: scatter repeats others
_MOST_AVERAGED = 16  # readings whose mean a logger takes: levels farther apart are the motion's
_ALIKE = 0.4  # of their mean: neighbouring intervals that differ by more are not meant to be equal
_CLIPPED = 5.0  # times the median: larger changes are gaps
_DENSE = 3.0  # times the shorter intervals (their quartile): up to these, readings are dense
_EXACT = 1e-6  # of an interval: less is rounding of the computer's
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
_WINDOWS = (8, 16)  # readings through which a parabola goes: rounding of fewer may fit it or not
_FEWEST_WINDOWS = 12  # that move: their median variance is then known to a fifth
_ALSO_LONGER = 1.3  # ratio of variances about longer and shorter parabolas that are both scatter
_BEYOND_ROUNDING = 0.3  # of the variance of rounding, beyond which there is a scatter


def encoder_step(displacement: Array) -> float:
    """Return the step to which readings were rounded; 0 if there is none or it does not show."""
    step = _lattice(displacement)
    return step * max(averaged(displacement, step), 1)


def _lattice(displacement: Array) -> float:
    """Return the step of which all changes are multiples; 0 if none is visible."""
    span = float(np.ptp(displacement))
    changes = np.diff(displacement)
    sizes = np.abs(changes)
    sizes = np.sort(sizes[sizes > 1e-9 * span])
    if sizes.size < 2:
        return 0.0
    if sizes[-1] - sizes[0] < _LEAST_STEP * max(float(sizes[-1]), span):
        moving = np.abs(changes) > 0.5 * sizes[0]
        alone = (moving[1:-1] != moving[:-2]) & (moving[1:-1] != moving[2:])
        if np.count_nonzero(alone) < (1 if sizes[0] < _LARGE * span else 6):
            return 0.0
    step = float(sizes[0])
    for _ in range(12):
        rest = _off_multiples(sizes, step)
        rest = rest[rest > max(0.05 * step, 1e-9 * span)]
        if rest.size == 0:
            counts = np.round(sizes / step)
            if step < _LEAST_STEP * span or (step > _LARGE * span and sizes.size < _PASSED):
                return 0.0
            return float(sizes @ counts / (counts @ counts))
        step = float(rest.min())
        if step < _LEAST_STEP * span:
            return 0.0
    return 0.0


def encoder_steps(displacements: Sequence[Array]) -> list[float]:
    """Return the step of each of several records by one encoder, 0 where none shows."""
    own = [_lattice(x) for x in displacements]
    least = min((step for step in own if step > 0.0), default=0.0)
    steps = [
        least if least > 0.0 and _divides(least, x) else step
        for step, x in zip(own, displacements, strict=True)
    ]
    means = [averaged(x, step) for step, x in zip(steps, displacements, strict=True)]
    typical = max(means, default=0)
    return [step * max(mean or typical, 1) for step, mean in zip(steps, means, strict=True)]


def _divides(step: float, displacement: Array) -> bool:
    """Return whether all changes are multiples of a step."""
    least = max(0.05 * step, 1e-9 * float(np.ptp(displacement)))
    return bool(np.all(_off_multiples(np.diff(displacement), step) <= least))


def _off_multiples(values: Array, step: float) -> Array:
    """Return how far values (n,) are from multiples of a step."""
    return np.abs(values - np.round(values / step) * step)


def averaged(displacement: Array, step: float) -> int:
    """Return how many rounded readings each reading is the mean of; 1 for one, 0 if unknown."""
    if step == 0.0:
        return 0
    change = np.flatnonzero(np.diff(displacement) != 0.0) + 1
    first, stop = np.append(0, change), np.append(change, displacement.size)
    level = stop - first >= _REPEATED
    first, stop = first[level], stop[level]
    next_to = first[1:] - stop[:-1] <= 1
    apart = np.abs(np.diff(displacement[first]))[next_to]
    apart = np.round(apart / step).astype(int)
    apart = apart[apart > 0]
    if apart.size < _LEVELS:
        return 0
    count = int(np.median(apart))
    whole = float(np.mean(apart % count == 0)) >= _WHOLE
    return count if whole and count <= _MOST_AVERAGED else 1


def clock_error(time: Array) -> float:
    """Return the sd (s) of each time stamp (n,) of a record; 0 where they are exact."""
    gaps = np.diff(time)
    if gaps.size < 2 or _are_multiples(gaps, float(gaps.min())):
        return 0.0
    step = last_decimal(gaps)
    if step > 0.0 and int(np.gcd.reduce(np.round(gaps / step).astype(np.int64))) > 1:
        return 0.0
    mean, change = 0.5 * (gaps[1:] + gaps[:-1]), np.diff(gaps)
    typical = float(np.median(np.abs(change) / mean))
    if typical > _ALIKE:
        return step / float(np.sqrt(12.0))
    alike = np.abs(change) < max(_ALIKE, _CLIPPED * typical) * mean
    alike &= mean < _DENSE * float(np.quantile(gaps, 0.25))
    pairs = alike[1:] & alike[:-1]
    if not pairs.any():
        return 0.0
    error = float(np.sqrt(max(-float(np.mean((change[1:] * change[:-1])[pairs])) / 4.0, 0.0)))
    return error if error > _EXACT * float(mean.min()) else 0.0


def last_decimal(values: Array) -> float:
    """Return the coarsest of 1, 0.1, ... 1e-9 of which all values are multiples; 0 if none."""
    return next((10.0**-k for k in range(10) if _are_multiples(values, 10.0**-k)), 0.0)


def _are_multiples(values: Array, step: float) -> bool:
    counts = values / step
    return bool(np.all(np.abs(counts - np.round(counts)) < 1e-3))


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
    single = max(0.75 * step, 0.5 * step + spread, floor)
    return Tolerance(single, max(step, 0.5 * step + spread, floor), spread, floor, noise, step)


def _scatter(time: Array, displacement: Array, step: float) -> float:
    """Return the scatter of as many readings as determine it, to limit memory."""
    t, x = time[:_SHOWING], displacement[:_SHOWING]
    return max(sensor_noise(t, x, step), dither(x, step), _scatter_in_motion(t, x, step))


def _scatter_in_motion(time: Array, displacement: Array, step: float) -> float:
    """Return the sd of a scatter below a step, by parabolas through readings that move; or 0.

    Rounding alone leaves a variance of step^2/12 about a parabola through 8 readings or more. A
    motion that no parabola follows leaves more about 16 readings than about 8.
    """
    if step == 0.0:
        return 0.0
    left = [_about_parabolas(time, displacement, step, count) for count in _WINDOWS]
    if min(left) == 0.0 or max(left) > _ALSO_LONGER * min(left):
        return 0.0
    beyond = min(left) - step**2 / 12.0
    return float(np.sqrt(beyond)) if beyond > _BEYOND_ROUNDING * step**2 / 12.0 else 0.0


def _about_parabolas(time: Array, displacement: Array, step: float, count: int) -> float:
    """Return the median variance about parabolas through ``count`` readings that move; or 0."""
    whole = time.size // count * count
    t, x = (values[:whole].reshape(-1, count) for values in (time, displacement))
    moves = np.ptp(x, axis=1) >= count * step / 4.0
    if np.count_nonzero(moves) < _FEWEST_WINDOWS:
        return 0.0
    t, x = t[moves], x[moves]
    u = (t - t[:, :1]) / np.ptp(t, axis=1, keepdims=True)
    design = np.stack([np.ones_like(u), u, u * u], axis=2)
    basis, _ = np.linalg.qr(design)
    off = x - x[:, :1]
    rest = off - (basis @ (basis.transpose(0, 2, 1) @ off[..., None]))[..., 0]
    return float(np.median(np.sum(rest**2, axis=1))) / (count - 3)


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
