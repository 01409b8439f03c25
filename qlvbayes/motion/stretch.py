r"""The motion between two dwells: constant accelerations or a smooth curve, whichever is simpler.

Both are fitted, and of those that are faithful to the readings the one that takes fewer numbers
from the record is kept: a trapezoid of velocity needs a few pieces of constant acceleration, a
sine a few spans of a quintic spline. At a reading a path may be off by what the reading's errors
explain, and between two readings by as much as these differ; else straight lines through some of
the readings take the place of the pieces that are, or of all if that does not help. Few readings
of a move from rest to rest have a trapezoid of velocity: with the share s = (t - t_0) / T of its
duration and the share r of speeding up and slowing down, a stroke D is

.. math:: x = x_0 + D \begin{cases} s^2 / 2r(1 - r) & s < r \\ (s - r/2) / (1 - r) & \\
          1 - (1 - s)^2 / 2r(1 - r) & s > 1 - r \end{cases}

Where the readings leave one of the three numbers open, the least acceleration is taken.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly
from scipy.ndimage import binary_dilation
from scipy.optimize import least_squares

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import DwellSpan, Tolerance
from qlvbayes.motion.freeknots import (
    DEGREE,
    FEWEST_PER_PIECE,
    insert_until_faithful,
    simplest,
    with_worthwhile_knots,
    worst_residual,
)
from qlvbayes.motion.splines import Flags, Joints, Stretch, Window, fit, smooth_curve

FEWEST_OF_A_MOVE = 15  # readings: five each of speeding up, cruising, slowing down, to show them
_CUBE = 8.0  # 2^3
_PLAIN = 4  # pieces of a trapezoid of velocity and one more: nothing smooth is simpler
_PER_PIECE = 2.5  # numbers a piece costs: its acceleration, its knot, now and then a kink
_PER_KINK = 2.5  # times the numbers that a curve may take where the pieces end in straight lines
_MOST_PIECES = 400  # beyond, only a smooth curve is tried first
_BETWEEN = np.linspace(0.0, 1.0, 8)[1:-1]  # of the time between two readings: where a path is seen
_SHARES = (0.5, *np.geomspace(0.48, 1e-3, 24))  # r, from a triangle to hardly more than a line
_REPAIRS = 3  # rounds in which lines take the place of pieces, before they do of the whole path
_MOVED = 1e-3  # of the stroke, from which a reading is taken to be in motion
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
    strayed = straying(stretch, tol)
    for _ in range(_REPAIRS):
        if not np.any(strayed):
            break
        stretch = with_lines(stretch, binary_dilation(strayed), tol)
        strayed = straying(stretch, tol)
    if np.any(strayed):
        return lines(t[first:stop], x[first:stop], stretch.joints, stretch.window, tol)
    return stretch


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
        return lines(t[low : high + 1], x[low : high + 1], ends, window, tol)
    # The last piece of a record that ends in motion may be a leftover of a few samples.
    end = stop if after is not None else stop - FEWEST_PER_PIECE
    cuts = [0.5 * (t[i - 1] + t[i]) for i, _ in segments if first < i < end]
    knots = np.array([t[low], *cuts, t[high]])
    if knots.size - 1 <= _PLAIN:
        plain = simplest(knots, left, right, window, tol)
        if worst_residual(plain, window, tol) <= tol.rest:
            return _constant(with_worthwhile_knots(plain, window, tol), window)
    ends = Joints(knots[[0, -1]], np.array([False, False]), left, right)
    curve = smooth_curve(ends, window, tol, nearly=knots.size > _MOST_PIECES)
    curve = None if curve is None or np.any(straying(curve, tol)) else curve
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
    spline = fit(joints, window.time, window.displacement, DEGREE)
    return Stretch(window, joints, DEGREE, spline.pieces(), _parameters(joints))


def _parameters(joints: Joints) -> int:
    """Return how many numbers pieces of constant acceleration took from the record."""
    inner = joints.kinked[1:-1]
    return 2 * inner.size + int(inner.sum()) + 3


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


def straying(stretch: Stretch, tol: Tolerance) -> Flags:
    """Return which pieces (k,) are off readings, or between two, by more than errors explain."""
    knots, time, x = stretch.joints.knots, stretch.window.time, stretch.window.displacement
    path = stretch.at(np.clip(time, knots[0], knots[-1]))
    off = [time[~(np.abs(path - x) <= tol.farthest)]]
    inside = (time >= knots[0]) & (time <= knots[-1])
    time, x = time[inside], x[inside]
    if time.size >= 2:
        if stretch.degree == 2:
            off += _overshoots(stretch, time, x, tol.farthest)
        off.append(_between_readings(stretch, time, x, tol.farthest))
    pieces = np.zeros(knots.size - 1, dtype=bool)
    every = np.searchsorted(knots, np.concatenate(off), side="right") - 1
    pieces[np.clip(every, 0, pieces.size - 1)] = True
    return pieces


def _between_readings(stretch: Stretch, time: Array, x: Array, most: float) -> Array:
    """Return times at which a path is off the line between two readings, beyond their changes."""
    knots = stretch.joints.knots
    moved = np.pad(np.abs(np.diff(x)), 1)
    bound = np.maximum(np.maximum(moved[:-2], moved[2:]), moved[1:-1]) + most
    every = np.concatenate([0.5 * (time[1:] + time[:-1]), 0.5 * (knots[1:] + knots[:-1]), knots])
    every = every[(every >= time[0]) & (every <= time[-1])]
    between = np.clip(np.searchsorted(time, every, side="right") - 1, 0, bound.size - 1)
    questioned = every[np.abs(stretch.at(every) - np.interp(every, time, x)) > bound[between]]
    return np.array([at for at in questioned if not _is_determined(stretch, time, at)])


def _overshoots(stretch: Stretch, time: Array, x: Array, most: float) -> tuple[Array, Array]:
    """Return both ends of where a path leaves the range of two readings, and does not turn."""
    between = time[:-1, None] + np.diff(time)[:, None] * _BETWEEN
    path, inner = stretch.at(time), stretch.at(between.ravel()).reshape(between.shape)
    moves = np.diff(x)
    moves[np.abs(moves) <= most] = 0.0
    one, two = np.pad(moves, 2)[1:-3], np.pad(moves, 2)[:-4]  # next to a turn one may be small
    before = np.where(one == 0.0, two, one)
    one, two = np.pad(moves, 2)[3:-1], np.pad(moves, 2)[4:]
    after = np.where(one == 0.0, two, one)
    turning = (before * moves < 0.0) | (moves * after < 0.0) | (before * after < 0.0)
    ends = np.stack([x[:-1], x[1:], path[:-1], path[1:]])
    above = inner.max(axis=1) - ends.max(axis=0)
    below = ends.min(axis=0) - inner.min(axis=1)
    left = (np.maximum(above, below) > most) & ~turning
    return time[:-1][left], time[1:][left]


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


def lines(time: Array, x: Array, ends: Joints, window: Window, tol: Tolerance) -> Stretch:
    """Return straight lines through some of the readings, from one dwell to the other."""
    x = x.copy()
    for at, level in ((0, ends.left), (-1, ends.right)):
        x[at] = x[at] if level is None else level
    own = _through(time, x, tol.rest)
    joints = Joints(own.x, np.ones(own.x.size, dtype=bool), ends.left, ends.right)
    return Stretch(window, joints, 2, own, 2 * own.x.size)


def with_lines(stretch: Stretch, some: Flags, tol: Tolerance) -> Stretch:
    """Return a path of constant accelerations with lines through readings in some pieces (k,)."""
    old, window, path = stretch.joints, stretch.window, stretch.pieces
    edges = np.flatnonzero(np.diff(np.concatenate([[False], some, [False]])))
    knots, rows, last = [old.knots[:1]], [], 0
    kinked = [old.knots[old.kinked]]
    for first, stop in edges.reshape(-1, 2).tolist():
        begin, end = old.knots[[first, stop]]
        inside = (window.time > begin) & (window.time < end)
        time = np.concatenate([[begin], window.time[inside], [end]])
        left, right = stretch.at(np.array([begin, end]))
        x = np.concatenate([[left], window.displacement[inside], [right]])
        through = _through(time, x, tol.rest)
        knots += [old.knots[last + 1 : first + 1], through.x[1:]]
        kinked.append(through.x)
        rows += [path.c[-3:, last:first], through.c]
        last = stop
    knots.append(old.knots[last + 1 :])
    rows.append(path.c[-3:, last:])
    new = np.concatenate(knots)
    joints = replace(old, knots=new, kinked=np.isin(new, np.concatenate(kinked)))
    pieces = PPoly(np.concatenate(rows, axis=1), new)
    return Stretch(window, joints, DEGREE, pieces, _parameters(joints))


def _through(time: Array, x: Array, tolerance: float) -> PPoly:
    """Return straight lines through those readings from which the others are no farther."""
    kept = corners(time, x, tolerance)
    time, x = time[kept], x[kept]
    slopes = np.diff(x) / np.diff(time)
    return PPoly(np.array([np.zeros(slopes.size), slopes, x[:-1]]), time)


def corners(time: Array, displacement: Array, tolerance: float) -> NDArray[np.intp]:
    """Return the indices of readings whose connecting lines stay within a tolerance.

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


def trapezoid(
    window: Window, left: float, right: float, variance: float
) -> tuple[Joints, PPoly, float] | None:
    """Return the trapezoid of least acceleration that fits readings, and its largest residual."""
    stroke, time = right - left, window.time
    share = (window.displacement - left) / stroke
    moving = np.flatnonzero((share > _MOVED) & (share < 1.0 - _MOVED))
    if moving.size < 3 or moving[0] == 0:
        return None
    first, last = max(moving[0] - 1, 0), min(moving[-1] + 1, time.size - 1)
    span = time[last] - time[first]
    low = np.array([max(time[first] - span, time[0]), 0.2 * span, _SHARES[-1]])
    high = np.array([time[moving[0]], 2.0 * span, _SHARES[0]])

    def off(parameters: Array) -> Array:
        return _shape(time, *parameters) - share

    def fit(start: Array, free: int) -> Array:
        """Fit the first ``free`` of the three parameters and keep the others."""

        def left_over(some: Array) -> Array:
            return off(np.concatenate([some, start[free:]]))

        bounds = low[:free], high[:free]
        solution = least_squares(left_over, np.clip(start[:free], *bounds), bounds=bounds)
        return np.concatenate([solution.x, start[free:]])

    fits = [fit(np.array([time[first], span, r]), 2) for r in _SHARES]
    costs = np.array([np.sum(off(one) ** 2) for one in fits])
    allowed = costs <= costs.min() + 4.0 * variance / stroke**2
    begin, duration, r = fit(fits[int(np.flatnonzero(allowed)[0])], 3)
    worst = abs(stroke) * float(np.max(np.abs(off(np.array([begin, duration, r])))))
    knots = begin + duration * np.array([0.0, r, 1.0 - r, 1.0])
    speed, rate = stroke / (duration * (1.0 - r)), stroke / (duration**2 * r * (1.0 - r))
    rates, kept = np.array([[0.5 * rate, 0.0, -0.5 * rate], [0.0, speed, speed]]), [0, 1, 2]
    if r > _SHARES[0] - _SHARES[-1]:  # nothing between speeding up and slowing down
        knots, kept = np.delete(knots, 2), [0, 2]
    start = left + stroke * _shape(knots[:-1], begin, duration, r)
    pieces = PPoly(np.concatenate([rates[:, kept], start[None]]), knots)
    return Joints(knots, np.zeros(knots.size, dtype=bool), left, right), pieces, worst


def _shape(time: Array, begin: Any, duration: Any, r: Any) -> Array:
    """Return the share of the stroke at times (n,) in s."""
    s = np.clip((time - begin) / duration, 0.0, 1.0)
    early, late = s**2 / (2.0 * r), 1.0 - r - (1.0 - s) ** 2 / (2.0 * r)
    return np.where(s < r, early, np.where(s > 1.0 - r, late, s - 0.5 * r)) / (1.0 - r)
