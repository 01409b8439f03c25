"""Replace a fitted path where it strays from its readings.

At a reading it may be off by what the reading's errors explain, and between two readings by as much
as these differ. Elsewhere straight lines through the readings, or a smooth path without further
turning points, take its place.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance
from qlvbayes.motion.fewreadings import changes, corners, monotone, strays_between
from qlvbayes.motion.freeknots import FEWEST_PER_PIECE
from qlvbayes.motion.splines import Joints, Pieces, Stretch, Window

_BETWEEN = np.linspace(0.0, 1.0, 8)[1:-1]  # of the time between two readings: where a path is seen
_NEXT_TO = 0.25  # of the time between two readings: nearer than that there is no further piece
_SINGULAR = 1e-12  # of the largest element: readings at fewer than three times give no parabola


def strays(stretch: Stretch, tol: Tolerance) -> bool:
    """Return whether a path deviates from readings, or between two, by more than errors explain."""
    knots, time, x = stretch.joints.knots, stretch.window.time, stretch.window.displacement
    path = stretch.at(np.clip(time, knots[0], knots[-1]))
    if not np.all(np.abs(path - x) <= tol.farthest):
        return True
    inside = (time >= knots[0]) & (time <= knots[-1])
    time, x = time[inside], x[inside]
    if time.size < 2:
        return False
    bound = changes(x) + tol.farthest
    every = np.concatenate([0.5 * (time[1:] + time[:-1]), 0.5 * (knots[1:] + knots[:-1]), knots])
    every = every[(every >= time[0]) & (every <= time[-1])]
    between = np.clip(np.searchsorted(time, every, side="right") - 1, 0, bound.size - 1)
    off = np.abs(stretch.at(every) - np.interp(every, time, x))
    questioned = every[off > bound[between]]
    return not all(_is_determined(stretch, time, at) for at in questioned)


def _is_determined(stretch: Stretch, time: Array, at: float) -> bool:
    """Return whether the readings of a piece give a path at a time as well as a reading there."""
    knots = stretch.joints.knots
    k = int(np.clip(np.searchsorted(knots, at, side="right") - 1, 0, knots.size - 2))
    within = time[(time >= knots[k]) & (time <= knots[k + 1])]
    if stretch.degree != 2 or within.size < FEWEST_PER_PIECE:
        return False
    scaled = (np.append(within, at) - knots[k]) / (knots[k + 1] - knots[k])
    design = np.vander(scaled, 3)
    root = np.linalg.qr(design[:-1])[1]
    if np.min(np.abs(np.diag(root))) <= _SINGULAR * np.max(np.abs(root)):
        return False
    return bool(np.sum(np.linalg.solve(root.T, design[-1]) ** 2) <= 1.0)


def lines(time: Array, x: Array, stretch: Stretch, tol: Tolerance) -> Stretch:
    """Return straight lines through some of the readings, from one dwell to the other."""
    left, right = stretch.joints.left, stretch.joints.right
    x = _to_levels(x, left, right)
    kept = corners(time, x, tol.rest)
    time, x = time[kept], x[kept]
    slopes = np.diff(x) / np.diff(time)
    joints = Joints(time, np.ones(time.size, dtype=bool), left, right)
    own = Pieces(time, x[:-1], slopes, np.zeros(slopes.size))
    return Stretch(stretch.window, joints, 2, own, 2 * time.size)


def through(time: Array, x: Array, ends: Joints, window: Window) -> Stretch:
    """Return a smooth path through all readings, with no other turning points."""
    joints = Joints(time, np.ones(time.size, dtype=bool), ends.left, ends.right)
    rests = (ends.left is not None, ends.right is not None)
    path = monotone(time, _to_levels(x, ends.left, ends.right), rests=rests)
    return Stretch(window, joints, 2, path, 2 * time.size)


def _to_levels(x: Array, left: float | None, right: float | None) -> Array:
    """Return the readings (n,) with the first and the last at the levels of their dwells."""
    adjusted = x.copy()
    adjusted[0], adjusted[-1] = (
        (x[0] if left is None else left),
        (x[-1] if right is None else right),
    )
    return adjusted


def patched(stretch: Stretch, tol: Tolerance) -> Stretch:
    """Interpolate the readings where the path leaves the range of two that do not turn."""
    knots, window = stretch.joints.knots, stretch.window
    inside = (window.time >= knots[0]) & (window.time <= knots[-1])
    time, x = window.time[inside], window.displacement[inside]
    if stretch.degree != 2 or time.size < 3:
        return stretch
    path = stretch.at(time)
    between = time[:-1, None] + np.diff(time)[:, None] * _BETWEEN
    off = strays_between(path, stretch.at(between.ravel()).reshape(between.shape), x, tol.farthest)
    for k in np.flatnonzero(off):
        stretch = _patch(stretch, time, x, time[k], time[k + 1], tol)
    return stretch


def _patch(
    stretch: Stretch, time: Array, x: Array, begin: float, end: float, tol: Tolerance
) -> Stretch:
    """Replace the pieces, or parts of pieces, that few readings around two of them show."""
    knots = stretch.pieces.knots
    few = np.diff(np.searchsorted(time, knots)) < FEWEST_PER_PIECE
    low = int(np.searchsorted(knots, begin, side="right")) - 1
    high = int(np.searchsorted(knots, end, side="left")) - 1
    while low >= 0 and few[low]:
        begin, low = knots[low], low - 1
    while high < few.size and few[high]:
        end, high = knots[high + 1], high + 1
    first = max(int(np.searchsorted(time, begin, side="right")) - 1, 0)
    last = min(int(np.searchsorted(time, end)), time.size - 1) + 1
    at, values = time[first:last], x[first:last].copy()
    if low < 0:
        at, values = (one[::-1] for one in _up_to(knots[0], at[::-1], values[::-1], stretch, tol))
    if high == few.size:
        at, values = _up_to(knots[-1], at, values, stretch, tol)
    values[[0, -1]] = stretch.at(at[[0, -1]])
    ends = stretch.joints
    rests = low < 0 and ends.left is not None, high == few.size and ends.right is not None
    return _spliced(stretch, monotone(at, values, rests=rests))


def _up_to(
    end: float, time: Array, x: Array, stretch: Stretch, tol: Tolerance
) -> tuple[Array, Array]:
    """Return readings (n,) in either order of time with the end of the path as their last."""
    near = abs(end - time[-1]) < _NEXT_TO * abs(time[-1] - time[-2])
    if near and abs(x[-1] - stretch.at(np.array([end]))[0]) <= tol.rest:
        return np.append(time[:-1], end), x
    return np.append(time, end), np.append(x, 0.0)


def _spliced(stretch: Stretch, made: Pieces) -> Stretch:
    """Replace the pieces between the first knot of others and their last."""
    old, begin, end = stretch.pieces, made.knots[0], made.knots[-1]
    rows, new = _coefficients(old), _coefficients(made)
    before = old.knots[:-1] < begin
    later = np.unique(np.append(end, old.knots[:-1][old.knots[:-1] > end]))
    later = later[later < old.knots[-1]]
    k = np.searchsorted(old.knots, later, side="right") - 1
    s = later - old.knots[k]
    d, v, a, h = rows[:, k]
    after = np.array(
        [d + s * (v + s * (0.5 * a + s * h)), v + s * (a + 3.0 * s * h), a + 6.0 * s * h, h]
    )
    knots = np.concatenate([old.knots[:-1][before], made.knots[:-1], later, old.knots[-1:]])
    d, v, a, h = np.concatenate([rows[:, before], new, after], axis=1)
    joints = stretch.joints
    kinked = np.isin(knots, joints.knots[joints.kinked]) | ((knots >= begin) & (knots <= end))
    kinked[[0, -1]] = joints.kinked[[0, -1]]
    joints = replace(joints, knots=knots, kinked=kinked)
    pieces = Pieces(knots, d, v, a, h[None])
    return Stretch(stretch.window, joints, 2, pieces, stretch.parameters + 2 * made.velocity.size)


def _coefficients(part: Pieces) -> Array:
    """Return displacement, velocity, acceleration and cubic coefficient (4, k) of each piece."""
    cubes = np.zeros((1, part.velocity.size)) if part.higher is None else part.higher
    return np.array([part.displacement, part.velocity, part.acceleration, *cubes])
