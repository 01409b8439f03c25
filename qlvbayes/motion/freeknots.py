"""Least-squares quadratic splines with free knots.

Between two knots the acceleration is constant. The knots are moved to the least squared residual,
added until every reading is met, and removed where the readings do not support them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance, excess
from qlvbayes.motion.splines import Flags, Joints, Window, fit

DEGREE = 2
_FEW = 10  # knots that are moved one by one;
_APART = 6  # of more, every sixth is nudged at once
_GAIN = 1e-4  # share of the squares: of a few hundred readings 0.02 in the log likelihood
_STEPS = (25, 10)  # of the search, with few knots and with many
_MOST_MOVED = 200  # knots that are moved at all
_MOST_PER_PIECE = 400
_FEWEST_RESOLVED = 3  # samples that show an acceleration
_EXTRA_KNOTS = 2
_MOST_WORTH = 10  # knots that are added to a path that is faithful without them
FEWEST_PER_PIECE = 5  # readings of a piece, below which they do not show it


def residuals(joints: Joints, time: Array, displacement: Array) -> Array:
    """Return readings minus the fitted spline, the dwells outside the end knots included."""
    return fit(joints, time, displacement, DEGREE).residuals


def _thinned(joints: Joints, window: Window) -> tuple[Array, Array]:
    """Return at most a few hundred samples of each piece and each margin."""
    edges = np.searchsorted(window.time, joints.knots)
    edges = np.unique(np.concatenate([[0], edges, [window.time.size]]))
    keep = [
        np.unique(np.linspace(i, j - 1, min(j - i, _MOST_PER_PIECE)).astype(int))
        for i, j in pairwise(edges)
    ]
    pick = np.concatenate(keep)
    return window.time[pick], window.displacement[pick]


def optimise(joints: Joints, window: Window) -> Joints:
    """Move the knots to the least squared residual (Levenberg-Marquardt on the knots alone)."""
    free = np.ones(joints.knots.size, dtype=bool)
    free[0], free[-1] = joints.left is not None, joints.right is not None
    which = np.flatnonzero(free)
    if which.size == 0 or which.size > _MOST_MOVED:
        return joints
    time, x = _thinned(joints, window)
    gap = 0.5 * float(np.median(np.diff(window.time)))
    best = residuals(joints, time, x)
    damping = 1e-3
    for _ in range(_STEPS[which.size > _FEW]):
        jacobian = _jacobian(joints, time, x, which, 0.02 * gap, best)
        gram, slope = jacobian.T @ jacobian, jacobian.T @ best
        gained = 0.0
        for _ in range(6):
            diagonal = np.diag(gram) * damping + 1e-300
            step = np.linalg.lstsq(gram + np.diag(diagonal), -slope, rcond=None)[0]
            moved = joints.knots.copy()
            moved[which] += step
            moved = _ordered(moved, window, gap)
            trial = replace(joints, knots=moved)
            error = residuals(trial, time, x)
            gained = float(best @ best - error @ error)
            if gained > 0.0:
                joints, best, damping = trial, error, 0.2 * damping
                break
            damping *= 8.0
        if gained <= _GAIN * float(best @ best):
            break
    return joints


def _jacobian(
    joints: Joints, time: Array, x: Array, which: NDArray[np.intp], nudge: float, now: Array
) -> Array:
    """Return the derivatives (n, knots) of the residuals, which are ``now``."""
    jacobian = np.zeros((time.size, which.size))
    last = joints.knots.size - 1
    apart = _APART if which.size > _FEW else which.size
    for first in range(apart):
        some = np.arange(first, which.size, apart)
        sides = np.where(which[some] == last, -nudge, nudge)
        moved = joints.knots.copy()
        moved[which[some]] += sides
        change = residuals(replace(joints, knots=moved), time, x) - now
        middles = 0.5 * (joints.knots[which[some][1:]] + joints.knots[which[some][:-1]])
        owner = np.searchsorted(middles, time)
        jacobian[np.arange(time.size), some[owner]] = change / sides[owner]
    return jacobian


def _ordered(knots: Array, window: Window, gap: float) -> Array:
    knots = np.clip(knots, window.earliest, window.latest)
    steps = gap * np.arange(knots.size)
    knots = np.maximum.accumulate(knots - steps) + steps
    back = knots[::-1] + steps
    back[0] = min(knots[-1], window.latest)
    return np.asarray((np.minimum.accumulate(back) - steps)[::-1])


def with_knot_at_worst(joints: Joints, window: Window, tol: Tolerance) -> Joints:
    """Halve the piece that has the reading, or run of readings, with the largest residual."""
    error = excess(residuals(joints, window.time, window.displacement), tol, tol.rest)
    at = float(window.time[int(np.argmax(error))])
    k = int(np.clip(np.searchsorted(joints.knots, at) - 1, 0, joints.knots.size - 2))
    middle = 0.5 * (joints.knots[k] + joints.knots[k + 1])
    return replace(
        joints,
        knots=np.insert(joints.knots, k + 1, middle),
        kinked=np.insert(joints.kinked, k + 1, False),
    )


def insert_until_faithful(joints: Joints, window: Window, tol: Tolerance) -> Joints:
    """Add knots until no residual exceeds its bound; in the limit the spline interpolates."""
    time, x = window.time, window.displacement
    for _ in range(40):
        failing = np.flatnonzero(excess(residuals(joints, time, x), tol, tol.rest) > 1.0)
        if failing.size == 0:
            break
        piece = np.searchsorted(joints.knots, time[failing], side="right") - 1
        joints = _refined(joints, np.unique(np.clip(piece, 0, joints.knots.size - 2)), time)
    return joints


def _refined(joints: Joints, failing: NDArray[np.intp], time: Array) -> Joints:
    knots, kinked = [joints.knots], [joints.kinked.copy()]
    for k in failing:
        i, j = np.searchsorted(time, joints.knots[k : k + 2])
        inside = time[i:j]
        if inside.size >= 6:
            middle = (i + j) // 2
            knots.append(np.array([0.5 * (time[middle - 1] + time[middle])]))
            kinked.append(np.array([False]))
        else:
            low, high = joints.knots[k], joints.knots[k + 1]
            inside = inside[(inside > low) & (inside < high)]
            knots.append(inside)
            kinked.append(np.ones(inside.size, dtype=bool))
            kinked[0][k : k + 2] = True
    return _merged(joints, np.concatenate(knots), np.concatenate(kinked), time)


def _merged(joints: Joints, knots: Array, kinked: Flags, time: Array) -> Joints:
    """Sort the knots; of two closer than a quarter of the samples there keep the later entry."""
    order = np.argsort(knots, kind="stable")
    near = 0.25 * np.diff(time)[np.clip(np.searchsorted(time, knots[order]) - 1, 0, time.size - 2)]
    keep = np.ones(knots.size, dtype=bool)
    for i in np.flatnonzero(np.diff(knots[order]) < near[:-1]):
        first, second = order[i], order[i + 1]
        ends = (0, joints.knots.size - 1)
        if first in ends and second in ends:
            continue
        drop = first if second in ends or (first not in ends and second > first) else second
        keep[drop] = False
    order = order[keep[order]]
    return replace(joints, knots=knots[order], kinked=kinked[order])


def simplest(
    knots: Array, left: float | None, right: float | None, window: Window, tol: Tolerance
) -> Joints:
    """Return the first choice of joints that agrees with the readings."""
    many = np.diff(np.searchsorted(window.time, knots)) >= FEWEST_PER_PIECE
    long = np.concatenate([[True], many[:-1] & many[1:], [True]])
    smooth_start = Joints(knots, np.zeros(knots.size, dtype=bool), left, right)
    best = optimise(smooth_start, window)
    least = worst_residual(best, window, tol)
    if least <= tol.rest and _fewest_samples(best, window) >= _FEWEST_RESOLVED:
        return best
    merged = Joints(knots[long], np.ones(int(long.sum()), dtype=bool), left, right)
    trial = optimise(merged, window)
    if worst_residual(trial, window, tol) <= tol.sample:
        return trial
    trial = best
    for _ in range(_EXTRA_KNOTS):
        if least <= tol.rest or trial.knots.size > _FEW:
            break
        trial = optimise(with_knot_at_worst(trial, window, tol), window)
        if (worst := worst_residual(trial, window, tol)) < least:
            best, least = trial, worst
    if least <= tol.rest and _fewest_samples(best, window) >= _FEWEST_RESOLVED:
        return best
    trial = optimise(replace(smooth_start, kinked=np.ones(knots.size, dtype=bool)), window)
    return trial if worst_residual(trial, window, tol) < max(least, tol.sample) else best


def with_worthwhile_knots(joints: Joints, window: Window, tol: Tolerance) -> Joints:
    """Remove and add knots by the gain in squared residuals against the cost of their parameters.

    Where readings scatter, several may each be off by less than scatter could make, and all
    together by more. A knot, and a kink, must lower the squares by 2 ln n variances for each of
    its numbers, as the best of n positions fits more of the scatter than a given one does (Zhang &
    Siegmund 2007). No path is asked to be better than the floor.
    """
    if tol.noise == 0.0:
        return joints
    number = 2.0 * max(tol.variance, tol.floor**2) * float(np.log(window.time.size))
    joints = _without_needless_knots(joints, window, tol, number)
    for _ in range(_MOST_WORTH):
        added = with_knot_at_worst(joints, window, tol)
        kinked = replace(added, kinked=added.kinked | ~np.isin(added.knots, joints.knots))
        trials = [optimise(some, window) for some in (added, kinked)]
        costs = [_squares(one, window) + k * number for one, k in zip(trials, (2, 3), strict=True)]
        best = int(np.argmin(costs))
        if costs[best] >= _squares(joints, window):
            break
        joints = trials[best]
    return joints


def _without_needless_knots(
    joints: Joints, window: Window, tol: Tolerance, number: float
) -> Joints:
    """Remove knots that the readings do not support, as scatter may divide a piece."""
    while 2 < joints.knots.size <= _FEW:
        trials = [
            optimise(replace(joints, knots=knots, kinked=kinked), window)
            for k in range(1, joints.knots.size - 1)
            for knots, kinked in [(np.delete(joints.knots, k), np.delete(joints.kinked, k))]
        ]
        best = min(trials, key=lambda trial: _squares(trial, window))
        lost = _squares(best, window) - _squares(joints, window)
        if lost >= 2.0 * number or worst_residual(best, window, tol) > tol.rest:
            break
        joints = best
    return joints


def _squares(joints: Joints, window: Window) -> float:
    return float(np.sum(residuals(joints, window.time, window.displacement) ** 2))


def worst_residual(joints: Joints, window: Window, tol: Tolerance) -> float:
    """Return the largest residual, or that of a run of readings scaled to its bound."""
    off = residuals(joints, window.time, window.displacement)
    return tol.rest * float(excess(off, tol, tol.rest).max())


def _fewest_samples(joints: Joints, window: Window) -> int:
    return int(np.diff(np.searchsorted(window.time, joints.knots)).min())
