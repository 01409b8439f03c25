"""Least-squares quadratic splines with free knots.

A spline has ``knots`` tau_0 < ... < tau_k; between two of them the acceleration is constant. The
displacement is continuous. The velocity is continuous too, except at the knots marked in
``kinked``. An end may be joined to a dwell: there the level is given and the velocity is 0 unless
that end is kinked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from qlvbayes.motion.bounds import Tolerance, excess

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_STIFFNESS = 1e-9  # keeps a piece without samples straight
PULL = 1e-8
"""Weight, over a reading's, of straight lines between readings, for pieces without readings."""
_FEW = 10  # knots that are moved one by one;
_APART = 6  # of more, every sixth is nudged at once
_GAIN = 1e-4  # share of the squares: of a few hundred readings 0.02 in the log likelihood
_STEPS = (25, 10)  # of the search, with few knots and with many
_MOST_MOVED = 200  # knots that are moved at all
_MOST_PER_PIECE = 400


@dataclass(frozen=True)
class Joints:
    """Knots, which of them carry a velocity jump, and the dwells at the ends (None: no dwell)."""

    knots: Array
    kinked: Flags
    left: float | None
    right: float | None


@dataclass(frozen=True)
class Window:
    """The samples of one stretch and how far its end knots may go."""

    time: Array
    displacement: Array
    earliest: float
    latest: float


@dataclass(frozen=True)
class Pieces:
    """Displacement, velocity and acceleration (k,) at the start of each of k polynomial pieces.

    ``higher`` (m, k): the coefficients of (t - start)^3, (t - start)^4, ...; none if the
    acceleration is constant.
    """

    knots: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    higher: Array | None = None


def _full_knots(joints: Joints) -> Array:
    repeats = np.where(joints.kinked, 2, 1)
    repeats[0] = repeats[-1] = 3
    return np.repeat(joints.knots, repeats)


def _spans(full: Array, time: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the span of each time and the three basis functions (3, n) that are non-zero there.

    The times must lie between the first knot and the last.
    """
    span = np.minimum(np.searchsorted(full, time, side="right") - 1, full.size - 4)
    length = full[1:] - full[:-1]
    with np.errstate(divide="ignore"):  # no time lies in a span without length
        first = 1.0 / ((full[2:] - full[:-2]) * length[1:])
        third = 1.0 / ((full[2:] - full[:-2]) * length[:-1])
    start, stop = full[span], full[span + 1]
    early = (stop - time) ** 2 * first[span - 1]
    late = (time - start) ** 2 * third[span]
    return span, np.stack([early, 1.0 - early - late, late])


def _straightening(full: Array) -> tuple[NDArray[np.intp], Array]:
    """Return, for each span, the weights of its coefficients in length^2 x acceleration."""
    span = np.flatnonzero(np.diff(full) > 0.0)
    a, b, c, d = full[span - 1], full[span], full[span + 1], full[span + 2]
    first = 2.0 * (c - b) / (c - a)
    third = 2.0 * (c - b) / (d - b)
    return span, np.stack([first, -first - third, third])


def _band(span: NDArray[np.intp], weights: Array, size: int) -> Array:
    """Return the upper banded form of the sum of the outer products of (3, n) weights."""
    band = np.zeros((3, size))
    for q in range(3):
        at = span - 2 + q
        for p in range(q + 1):
            band[2 - (q - p)] += np.bincount(at, weights=weights[p] * weights[q], minlength=size)
    return band


@dataclass(frozen=True)
class _Solved:
    """A least-squares spline: full knots, coefficients; span and basis (3, n) of each sample."""

    full: Array
    coefficients: Array
    span: NDArray[np.intp]
    basis: Array


def _solved(joints: Joints, time: Array, displacement: Array, *, pull: bool = False) -> _Solved:
    """Return the spline that minimises the squared residuals.

    pull: towards straight lines between readings in pieces without readings.
    """
    full = _full_knots(joints)
    size = full.size - 3
    origin = float(displacement[0])
    inside = np.minimum(np.maximum(time, joints.knots[0]), joints.knots[-1])
    span, basis = _spans(full, inside)
    bend, weights = _straightening(full)
    rows = np.concatenate([basis, np.sqrt(_STIFFNESS) * weights], axis=1)
    band = _band(np.concatenate([span, bend]), rows, size)
    y = displacement - origin
    right_side = np.zeros(size)
    for p in range(3):
        right_side += np.bincount(span - 2 + p, weights=basis[p] * y, minlength=size)
    if pull:
        at, pulled, lines = _between(joints, full, time, y)
        band += PULL * _band(at, pulled, size)
        for p in range(3):
            right_side += PULL * np.bincount(at - 2 + p, weights=pulled[p] * lines, minlength=size)
    low = 0 if joints.left is None else (1 if joints.kinked[0] else 2)
    high = size - (0 if joints.right is None else (1 if joints.kinked[-1] else 2))
    c = np.zeros(size)
    if joints.left is not None:
        c[:low] = joints.left - origin
    if joints.right is not None:
        c[high:] = joints.right - origin
    if high > low:
        for off in (1, 2):
            diagonal = band[2 - off, off:]
            right_side[:-off] -= diagonal * c[off:]
            right_side[off:] -= diagonal * c[:-off]
        free = band[:, low:high].copy()
        free[1, :1] = 0.0
        free[0, :2] = 0.0
        free[2] += 1e-14 * free[2].max()
        c[low:high] = solveh_banded(free, right_side[low:high], check_finite=False)
    return _Solved(full, c + origin, span, basis)


def _between(
    joints: Joints, full: Array, time: Array, y: Array
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return span, basis (3, k) and interpolated reading at k knots without readings.

    Beside such a one lies a piece without readings.
    """
    inside = np.searchsorted(time, joints.knots[1:], "left")
    inside -= np.searchsorted(time, joints.knots[:-1], "right")
    lonely = (inside[1:] <= 0) | (inside[:-1] <= 0)
    inner = joints.knots[1:-1][lonely]
    span, basis = _spans(full, inner)
    return span, basis, np.interp(inner, time, y)


def residuals(joints: Joints, time: Array, displacement: Array) -> Array:
    """Return readings minus the fitted spline, the dwells outside the end knots included."""
    solved = _solved(joints, time, displacement)
    c, span, basis = solved.coefficients, solved.span, solved.basis
    return displacement - (basis[0] * c[span - 2] + basis[1] * c[span - 1] + basis[2] * c[span])


def pieces(joints: Joints, window: Window) -> Pieces:
    """Return the fitted spline piece by piece."""
    solved = _solved(joints, window.time, window.displacement, pull=True)
    full, k = solved.full, solved.coefficients
    span = np.flatnonzero(np.diff(full) > 0.0)
    a, b, c, d = full[span - 1], full[span], full[span + 1], full[span + 2]
    velocity = 2.0 * (k[span - 1] - k[span - 2]) / (c - a)
    after = 2.0 * (k[span] - k[span - 1]) / (d - b)
    start = k[span - 2] + (k[span - 1] - k[span - 2]) * (b - a) / (c - a)
    return Pieces(joints.knots, start, velocity, (after - velocity) / (c - b))


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
    """Move the knots to the least squared residual (Levenberg-Marquardt on the knots alone).

    An end knot moves only where it joins a dwell.
    """
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
    """Return the derivatives (n, knots) of the residuals, which are ``now``.

    A knot is felt by a few pieces around it: distant knots are nudged at once, and each takes the
    change about it.
    """
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
    """Add knots until no residual exceeds its bound; in the limit the spline interpolates.

    Each round halves the pieces that fail; a piece too short to halve is followed from sample to
    sample by straight lines. So it ends after about log2 of the number of samples.
    """
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
    """Sort the knots; of two closer than a quarter of the samples there keep the later entry.

    The ends stay, however close.
    """
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
