"""The motion between two dwells: constant accelerations or a smooth curve, whichever is simpler.

Both are fitted, and of those that are faithful to the readings the one that takes fewer numbers
from the record is kept: a trapezoid of velocity needs a few pieces of constant acceleration, a
sine a few spans of a quintic spline. At a reading a path may be off by what the reading's errors
explain, and between two readings by as much as these differ; else straight lines through the
readings take its place. Where it leaves the range of two readings that do not turn, monotone cubics
take the place of the pieces there, and of no others: cubics through all readings of a slow creep
would follow the encoder's steps.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import DwellSpan, Tolerance
from qlvbayes.motion.fewreadings import corners, monotone, strays_between, trapezoid
from qlvbayes.motion.freeknots import (
    DEGREE,
    FEWEST_PER_PIECE,
    insert_until_faithful,
    simplest,
    with_worthwhile_knots,
    worst_residual,
)
from qlvbayes.motion.splines import Joints, Stretch, Window, changes, expanded, fit, smooth_curve

FEWEST_OF_A_MOVE = 15  # readings: five each of speeding up, cruising, slowing down, to show them
_CUBE = 8.0  # 2^3
_PLAIN = 4  # pieces of a trapezoid of velocity and one more: nothing smooth is simpler
_PER_PIECE = 2.5  # numbers a piece costs: its acceleration, its knot, now and then a kink
_PER_KINK = 2.5  # times the numbers that a curve may take where the pieces end in straight lines
_MOST_PIECES = 400  # beyond, only a smooth curve is tried first
_BETWEEN = np.linspace(0.0, 1.0, 8)[1:-1]  # of the time between two readings: where a path is seen
_NEXT_TO = 0.25  # of the time between two readings: nearer than that there is no further piece
_SINGULAR = 1e-12  # of the largest element: readings at fewer than three times give no parabola


def fitted(
    t: Array,
    x: Array,
    segments: list[tuple[int, int]],
    before: DwellSpan | None,
    after: DwellSpan | None,
    tol: Tolerance,
) -> Stretch:
    """Fit the motion between two dwells (None: the record begins or ends in motion)."""
    stretch = _fitted(t, x, segments, before, after, tol)
    left = x[0] if before is None else before.level
    if (move := _one_move(stretch, left, after, tol)) is not None:
        return move
    first = 0 if before is None else before.stop - 1
    stop = t.size if after is None else after.first + 1
    if strays(stretch, tol):
        return lines(t[first:stop], x[first:stop], stretch, tol)
    return patched(stretch, tol)


def _one_move(
    stretch: Stretch, left: float, after: DwellSpan | None, tol: Tolerance
) -> Stretch | None:
    """Return a trapezoid of velocity from a level to a dwell, if few readings show the motion."""
    time, knots = stretch.window.time, stretch.joints.knots
    readings = np.count_nonzero((time >= knots[0]) & (time <= knots[-1]))
    if after is None or after.level == left or readings >= FEWEST_OF_A_MOVE:
        return None
    made = trapezoid(stretch.window, left, after.level, tol.variance)
    if made is None:
        return None
    joints, own, worst = made
    move = Stretch(stretch.window, joints, 2, own, 3)
    # by what the numbers and the kinks saved are worth, as in `freeknots.with_worthwhile_knots`
    price = 2.0 * max(tol.variance, tol.floor**2) * float(np.log(stretch.window.time.size))
    saved = stretch.parameters + int(stretch.joints.kinked[[0, -1]].sum()) - move.parameters
    costs = _misfit(move), _misfit(stretch) + saved * price
    return move if worst <= tol.rest and costs[0] <= costs[1] else None


def _misfit(stretch: Stretch) -> float:
    """Return the sum of the squared residuals."""
    time, knots = stretch.window.time, stretch.pieces.x
    path = stretch.at(np.clip(time, knots[0], knots[-1]))
    return float(np.sum((path - stretch.window.displacement) ** 2))


def _fitted(
    t: Array,
    x: Array,
    segments: list[tuple[int, int]],
    before: DwellSpan | None,
    after: DwellSpan | None,
    tol: Tolerance,
) -> Stretch:
    first = 0 if before is None else before.stop
    stop = t.size if after is None else after.first
    low = first - 1 if before is not None else first
    high = stop if after is not None else stop - 1
    left, right = (r.level if r is not None else None for r in (before, after))
    window = _window(t, x, first, stop, before, after)
    if stop - first < 3:
        ends = Joints(t[[low, high]], np.ones(2, dtype=bool), left, right)
        return through(t[low : high + 1], x[low : high + 1], ends, window)
    # The last piece of a record that ends in motion may be a leftover of a few samples.
    end = stop if after is not None else stop - FEWEST_PER_PIECE
    cuts = [0.5 * (t[i - 1] + t[i]) for i, _ in segments if first < i < end]
    knots = np.array([t[low], *cuts, t[high]])
    if knots.size - 1 <= _PLAIN:
        plain = simplest(knots, left, right, window, tol)
        if worst_residual(plain, window, tol) <= tol.rest:
            return _constant(with_worthwhile_knots(plain, window, tol), window)
    ends = Joints(knots[[0, -1]], np.array([False, False]), left, right)
    curve = smooth_curve(ends, window, tol)
    if curve is not None and (
        curve.parameters <= _PER_PIECE * knots.size or knots.size > _MOST_PIECES
    ):
        return curve
    plain = simplest(knots, left, right, window, tol)
    faithful = with_worthwhile_knots(insert_until_faithful(plain, window, tol), window, tol)
    constant = _constant(faithful, window)
    price = _PER_KINK if faithful.knots.size > plain.knots.size else 1.0
    if curve is not None and curve.parameters < price * constant.parameters:
        return curve
    return constant


def _constant(joints: Joints, window: Window) -> Stretch:
    """Return pieces of constant acceleration; a free knot counts as a parameter."""
    inner = joints.kinked[1:-1]
    parameters = 2 * inner.size + int(inner.sum()) + 3
    spline = fit(joints, window.time, window.displacement, DEGREE)
    return Stretch(window, joints, DEGREE, spline.pieces(), parameters)


def _window(
    t: Array, x: Array, first: int, stop: int, before: DwellSpan | None, after: DwellSpan | None
) -> Window:
    """Include part of the dwells next to a stretch, so that its end knots can move."""
    reach = max(20, (stop - first) // 4)
    i = first if before is None else first - min(reach, (before.stop - before.first) // 2)
    j = stop if after is None else stop + min(reach, (after.stop - after.first) // 2)
    margins = slice(first - (before is not None), stop + (after is not None))
    between = float(np.median(np.diff(t[margins]))) * np.arange(1.0, reach + 1.0)
    n = t.size
    early = -_unseen(-t[::-1], x[::-1], n - stop, n - first, n - i, before, between)
    late = _unseen(t, x, first, stop, j, after, between)
    levels = [0.0 if dwell is None else dwell.level for dwell in (before, after)]
    added = [np.full(some.size, level) for some, level in zip((early, late), levels, strict=True)]
    time = np.concatenate([early, t[i:j], late])
    order = np.argsort(time, kind="stable")
    x_all = np.concatenate([added[0], x[i:j], added[1]])
    return Window(time[order], x_all[order], float(t[i]), float(t[j - 1]))


def _unseen(
    t: Array, x: Array, first: int, stop: int, end: int, dwell: DwellSpan | None, between: Array
) -> Array:
    """Return times after a stretch first:stop at which a dwell's level held without readings."""
    if dwell is None or not first < stop < end:
        return t[:0]
    back = slice(stop - 1, first - 1 if first else None, -1)
    gap = _at_rest(t[back], np.abs(x[back] - dwell.level), t[stop], between)
    return np.append(_unread(t[stop:end], t[stop] + between), gap)


def _unread(t: Array, times: Array) -> Array:
    """Return those of evenly spaced times, between first and last reading, with no reading near."""
    after = np.clip(np.searchsorted(t, times), 1, t.size - 1)
    gap = np.minimum(np.abs(times - t[after - 1]), np.abs(times - t[after]))
    near = gap <= abs(times[1] - times[0])
    return times[~near & (times > t[0]) & (times < t[-1])]


def _at_rest(t: Array, away: Array, resting: float, between: Array) -> Array:
    """Return times between the end of a motion and the first reading at rest."""
    farther = np.flatnonzero(away >= _CUBE * away[0])
    over = 2.0 * t[0] - t[farther[0]] if farther.size else t[0] + between[2]
    if over >= resting - between[0]:
        return t[:0]
    count = min(between.size, int((resting - over) / between[0]))
    return over + np.geomspace(between[0], resting - over, count + 1)[:-1] - between[0]


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
    own = PPoly(np.array([np.zeros(slopes.size), slopes, x[:-1]]), time)
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
    knots = stretch.pieces.x
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


def _spliced(stretch: Stretch, made: PPoly) -> Stretch:
    """Replace the pieces between the first knot of cubics and their last."""
    old, begin, end = stretch.pieces, made.x[0], made.x[-1]
    before = old.x[:-1] < begin
    later = np.unique(np.append(end, old.x[:-1][old.x[:-1] > end]))
    later = later[later < old.x[-1]]
    kept = np.pad(old.c[:, before], ((4 - len(old.c), 0), (0, 0)))
    knots = np.concatenate([old.x[:-1][before], made.x[:-1], later, old.x[-1:]])
    pieces = PPoly(np.concatenate([kept, made.c, expanded(old, later, 4)], axis=1), knots)
    joints = stretch.joints
    kinked = np.isin(knots, joints.knots[joints.kinked]) | ((knots >= begin) & (knots <= end))
    kinked[[0, -1]] = joints.kinked[[0, -1]]
    joints = replace(joints, knots=knots, kinked=kinked)
    return Stretch(stretch.window, joints, 2, pieces, stretch.parameters + 2 * made.c.shape[1])
