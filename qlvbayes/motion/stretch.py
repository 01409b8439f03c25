"""The motion between two dwells: constant accelerations or a smooth curve, whichever is simpler.

Both are fitted, and of those that are faithful to the readings the one that takes fewer numbers
from the record is kept: a trapezoid of velocity needs a few pieces of constant acceleration, a
sine a few spans of a quintic spline.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from qlvbayes.motion import quintic
from qlvbayes.motion.bounds import Tolerance, excess
from qlvbayes.motion.fewreadings import corners, monotone, strays_between, trapezoid
from qlvbayes.motion.freeknots import (
    insert_until_faithful,
    optimise,
    pieces,
    residuals,
    with_knot_at_worst,
)
from qlvbayes.motion.segments import DwellSpan
from qlvbayes.motion.splines import Joints, Pieces, Spline, Window

Array = NDArray[np.float64]

FEWEST_OF_A_MOVE = 15
"""Readings of speeding up, cruising and slowing down, five each: fewer show no acceleration."""

_FEWEST_PER_PIECE = 5
_FEWEST_RESOLVED = 3  # samples that show an acceleration
_BETWEEN = np.linspace(0.0, 1.0, 8)[1:-1]  # of the time between two readings: where a path is seen
_EXTRA_KNOTS = 2
_INWARD = 0.8  # of the first span: how far an end may move into it
_CUBE = 8.0  # 2^3
_SINGULAR = 1e-12  # of the largest element: readings at fewer than three times give no parabola
_FEW_KNOTS = 10  # beyond, another one is not tried
_PLAIN = 4  # pieces of a trapezoid of velocity and one more: nothing smooth is simpler
_PER_PIECE = 2.5  # numbers a piece costs: its acceleration, its knot, now and then a kink
_PER_KINK = 2.5  # times the numbers that a curve may take where the pieces end in straight lines
_MOST_WORTH = 10  # knots that are added to a path that is faithful without them
_MOST_PIECES = 400  # beyond, only a smooth curve is tried first


@dataclass(frozen=True)
class Stretch:
    """A fitted stretch: its window, its joints, their degree, and the motion piece by piece.

    ``parameters``: how many numbers the record had to give for it.
    """

    window: Window
    joints: Joints
    degree: int
    pieces: Pieces
    parameters: int


def fitted(
    t: Array,
    x: Array,
    segments: list[tuple[int, int]],
    before: DwellSpan | None,
    after: DwellSpan | None,
    tol: Tolerance,
) -> Stretch:
    """Fit the motion between two dwells (None: the record begins or ends in motion).

    Where few readings show its pieces, a trapezoid of velocity that is as faithful takes their
    place. What strays from the readings, at them or between them, is replaced by straight lines.
    """
    stretch = _fitted(t, x, segments, before, after, tol)
    if (
        move := _one_move(stretch, x[0] if before is None else before.level, after, tol)
    ) is not None:
        return move
    if strays(stretch, tol):
        first = 0 if before is None else before.stop - 1
        stop = t.size if after is None else after.first + 1
        return _lines(t[first:stop], x[first:stop], stretch, tol)
    return _patched(stretch, tol)


def _one_move(
    stretch: Stretch, left: float, after: DwellSpan | None, tol: Tolerance
) -> Stretch | None:
    """Return a trapezoid of velocity from a level to a dwell, if few readings show the motion.

    None where they are many, or do not lie on a trapezoid. They do not determine its acceleration.
    """
    time, knots = stretch.window.time, stretch.joints.knots
    readings = np.count_nonzero((time >= knots[0]) & (time <= knots[-1]))
    if after is None or after.level == left or readings >= FEWEST_OF_A_MOVE:
        return None
    made = trapezoid(stretch.window, left, after.level, tol.variance)
    if made is None:
        return None
    joints, own, worst = made
    move = Stretch(stretch.window, joints, 2, own, 3)
    # by what the numbers and the kinks saved are worth, as in `_worth`
    price = 2.0 * max(tol.variance, tol.floor**2) * float(np.log(stretch.window.time.size))
    saved = stretch.parameters + int(stretch.joints.kinked[[0, -1]].sum()) - move.parameters
    costs = _misfit(move), _misfit(stretch) + saved * price
    return move if worst <= tol.rest and costs[0] <= costs[1] else None


def _misfit(stretch: Stretch) -> float:
    """Return the sum of the squared residuals."""
    time, knots = stretch.window.time, stretch.pieces.knots
    path = evaluated(stretch, np.clip(time, knots[0], knots[-1]))
    return float(np.sum((path - stretch.window.displacement) ** 2))


def strays(stretch: Stretch, tol: Tolerance) -> bool:
    """Return whether a path deviates from a reading, or between two, by more than errors explain.

    Between two readings it may leave their line by as much as these or their neighbours differ, and
    by more where the readings of its piece determine it as well as one would.
    """
    knots, time, x = stretch.joints.knots, stretch.window.time, stretch.window.displacement
    path = evaluated(stretch, np.clip(time, knots[0], knots[-1]))
    if not np.all(np.abs(path - x) <= tol.farthest):
        return True
    inside = (time >= knots[0]) & (time <= knots[-1])
    time, x = time[inside], x[inside]
    if time.size < 2:
        return False
    bound = _changes(x) + tol.farthest
    every = np.concatenate([0.5 * (time[1:] + time[:-1]), 0.5 * (knots[1:] + knots[:-1]), knots])
    every = every[(every >= time[0]) & (every <= time[-1])]
    between = np.clip(np.searchsorted(time, every, side="right") - 1, 0, bound.size - 1)
    off = np.abs(evaluated(stretch, every) - np.interp(every, time, x))
    questioned = every[off > bound[between]]
    return not all(_is_determined(stretch, time, at) for at in questioned)


def _changes(x: Array) -> Array:
    """Return by how much two readings or their neighbours differ, (n - 1,) for n readings."""
    moved = np.abs(np.diff(x))
    around = np.maximum(np.append(moved[1:], 0.0), np.append(0.0, moved[:-1]))
    return np.maximum(moved, around)


def _is_determined(stretch: Stretch, time: Array, at: float) -> bool:
    """Return whether the readings of a piece give a path at a time as well as a reading there.

    The path is a parabola through the readings at times (n,) of the piece; their errors, of one
    variance, give its value there that variance times the leverage, which is at most 1.
    """
    knots = stretch.joints.knots
    k = int(np.clip(np.searchsorted(knots, at, side="right") - 1, 0, knots.size - 2))
    within = time[(time >= knots[k]) & (time <= knots[k + 1])]
    if stretch.degree != 2 or within.size < _FEWEST_PER_PIECE:
        return False
    scaled = (np.append(within, at) - knots[k]) / (knots[k + 1] - knots[k])
    design = np.vander(scaled, 3)
    root = np.linalg.qr(design[:-1])[1]
    if np.min(np.abs(np.diag(root))) <= _SINGULAR * np.max(np.abs(root)):
        return False
    return bool(np.sum(np.linalg.solve(root.T, design[-1]) ** 2) <= 1.0)


def evaluated(stretch: Stretch, t: Array) -> Array:
    """Return the displacement of the fitted pieces at times inside them."""
    part = stretch.pieces
    k = np.clip(np.searchsorted(part.knots, t, side="right") - 1, 0, part.knots.size - 2)
    s = t - part.knots[k]
    value = np.zeros_like(t)
    if part.higher is not None:
        for row in part.higher[::-1]:
            value = s * (value + row[k])
    return part.displacement[k] + s * (part.velocity[k] + s * (0.5 * part.acceleration[k] + value))


def _lines(time: Array, x: Array, stretch: Stretch, tol: Tolerance) -> Stretch:
    """Return straight lines through some of the readings, from one dwell to the other."""
    left, right = stretch.joints.left, stretch.joints.right
    x = _to_levels(x, left, right)
    kept = corners(time, x, tol.rest)
    time, x = time[kept], x[kept]
    slopes = np.diff(x) / np.diff(time)
    joints = Joints(time, np.ones(time.size, dtype=bool), left, right)
    lines = Pieces(time, x[:-1], slopes, np.zeros(slopes.size))
    return Stretch(stretch.window, joints, 2, lines, 2 * time.size)


def _through(time: Array, x: Array, ends: Joints, window: Window) -> Stretch:
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


def _patched(stretch: Stretch, tol: Tolerance) -> Stretch:
    """Interpolate the readings where the path leaves the range of two that do not turn."""
    knots, window = stretch.joints.knots, stretch.window
    inside = (window.time >= knots[0]) & (window.time <= knots[-1])
    time, x = window.time[inside], window.displacement[inside]
    if stretch.degree != 2 or time.size < 3:
        return stretch
    path = evaluated(stretch, time)
    between = time[:-1, None] + np.diff(time)[:, None] * _BETWEEN
    off = strays_between(
        path, evaluated(stretch, between.ravel()).reshape(between.shape), x, tol.farthest
    )
    for k in np.flatnonzero(off):
        stretch = _patch(stretch, time, x, time[k], time[k + 1])
    return stretch


def _patch(stretch: Stretch, time: Array, x: Array, begin: float, end: float) -> Stretch:
    """Replace the pieces, or parts of pieces, that few readings around two of them show."""
    knots = stretch.pieces.knots
    few = np.diff(np.searchsorted(time, knots)) < _FEWEST_PER_PIECE
    low = int(np.searchsorted(knots, begin, side="right")) - 1
    high = int(np.searchsorted(knots, end, side="left")) - 1
    while low >= 0 and few[low]:
        begin, low = knots[low], low - 1
    while high < few.size and few[high]:
        end, high = knots[high + 1], high + 1
    first = max(int(np.searchsorted(time, begin, side="right")) - 1, 0)
    last = min(int(np.searchsorted(time, end)), time.size - 1) + 1
    at, values = time[first:last], x[first:last].copy()
    if low < 0 and at[0] > knots[0]:
        at, values = np.append(knots[0], at), np.append(0.0, values)
    if high == few.size and at[-1] < knots[-1]:
        at, values = np.append(at, knots[-1]), np.append(values, 0.0)
    values[[0, -1]] = evaluated(stretch, at[[0, -1]])
    ends = stretch.joints
    rests = low < 0 and ends.left is not None, high == few.size and ends.right is not None
    return _spliced(stretch, monotone(at, values, rests=rests))


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
        return _through(t[low : high + 1], x[low : high + 1], ends, window)
    # The last piece of a record that ends in motion may be a leftover of a few samples.
    end = stop if after is not None else stop - _FEWEST_PER_PIECE
    cuts = [0.5 * (t[i - 1] + t[i]) for i, _ in segments if first < i < end]
    knots = np.array([t[low], *cuts, t[high]])
    if knots.size - 1 <= _PLAIN:
        simplest = _simplest(knots, left, right, window, tol)
        if _worst(simplest, window, tol) <= tol.rest:
            return _constant(_worth(simplest, window, tol), window)
    ends = Joints(knots[[0, -1]], np.array([False, False]), left, right)
    curve = _smooth(ends, window, tol)
    if curve is not None and (
        curve.parameters <= _PER_PIECE * knots.size or knots.size > _MOST_PIECES
    ):
        return curve
    simplest = _simplest(knots, left, right, window, tol)
    faithful = _worth(insert_until_faithful(simplest, window, tol), window, tol)
    constant = _constant(faithful, window)
    price = _PER_KINK if faithful.knots.size > simplest.knots.size else 1.0
    return (
        curve if curve is not None and curve.parameters < price * constant.parameters else constant
    )


def _constant(joints: Joints, window: Window) -> Stretch:
    """Return pieces of constant acceleration; a free knot counts as a parameter."""
    inner = joints.kinked[1:-1]
    parameters = 2 * inner.size + int(inner.sum()) + 3
    return Stretch(window, joints, 2, pieces(joints, window), parameters)


def _smooth(ends: Joints, window: Window, tol: Tolerance) -> Stretch | None:
    """Return a quintic spline; None if none agrees with the readings."""
    spline, faithful = quintic.refined(ends, window, tol)
    if ends.left is not None or ends.right is not None:
        for side in (0, -1):
            spline = _with_better_end(spline, side, window)
        ends = Joints(
            spline.joints.knots[[0, -1]], spline.joints.kinked[[0, -1]], ends.left, ends.right
        )
        spline, faithful = quintic.refined(ends, window, tol)
    if not faithful or _wanders(spline, window, tol):
        return None
    return Stretch(window, spline.joints, quintic.DEGREE, spline.pieces(), spline.parameters)


def _wanders(spline: Spline, window: Window, tol: Tolerance) -> bool:
    """Return whether a path deviates from the line between two readings by more than their change.

    A smooth curve that readings show does not: it has room to where they are far apart.
    """
    time, x = window.time, window.displacement
    inside = (time >= spline.joints.knots[0]) & (time <= spline.joints.knots[-1])
    time, x = time[inside], x[inside]
    if time.size < 2:
        return False
    middle = 0.5 * (time[1:] + time[:-1])
    off = spline.displacement(middle) - 0.5 * (x[1:] + x[:-1])
    return bool(np.any(np.abs(off) > _changes(x) + 2.0 * tol.rest))


def _with_better_end(spline: Spline, side: int, window: Window) -> Spline:
    """Move an end that joins a dwell to where the squared residuals nearby are smallest."""
    joints = spline.joints
    if (joints.left if side == 0 else joints.right) is None:
        return spline
    here, neighbour = joints.knots[side], joints.knots[1 if side == 0 else -2]
    few = joints.knots[:6] if side == 0 else joints.knots[-6:]
    outward = few[0] - few[-1] if side == 0 else few[-1] - few[0]
    near = np.sort(np.array([here + outward, here + _INWARD * (neighbour - here)]))
    near = np.clip(near, window.earliest, window.latest)
    inside = (window.time >= min(near[0], few[0])) & (window.time <= max(near[1], few[-1]))
    part = replace(window, time=window.time[inside], displacement=window.displacement[inside])

    def lost(end: float) -> float:
        return float(np.sum(quintic.fit(_local(joints, side, end), part).residuals ** 2))

    end = float(minimize_scalar(lost, bounds=near, method="bounded", options={"maxiter": 25}).x)
    if lost(end) >= lost(float(here)):
        return spline
    moved = joints.knots.copy()
    moved[side] = end
    return replace(spline, joints=replace(joints, knots=moved))


def _local(joints: Joints, side: int, end: float) -> Joints:
    """Return the joints next to one end, with that end moved."""
    part = slice(0, 6) if side == 0 else slice(-6, None)
    knots = joints.knots[part].copy()
    knots[side] = end
    whole = joints.knots.size <= 6
    left = joints.left if side == 0 or whole else None
    right = joints.right if side == -1 or whole else None
    return Joints(knots, joints.kinked[part], left, right)


def _window(
    t: Array, x: Array, first: int, stop: int, before: DwellSpan | None, after: DwellSpan | None
) -> Window:
    """Include part of the dwells next to a stretch, so that its end knots can move.

    A dwell is at its level between its readings too, and in a gap next to the stretch until the
    motion can have begun: where readings are sparser there than the stretch's, some are put between
    them, or the motion could do anything.
    """
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
    """Return times after a stretch first:stop at which a dwell's level held without readings.

    Up to the reading ``end``; between: multiples of the median spacing of the stretch's readings.
    """
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
    """Return times between the end of a motion and the first reading at rest.

    t, away (n,): its readings, the last one first, and how far each is from the dwell's level;
    between: multiples of their median spacing. As a motion ends with the cube of the time at the
    latest (a bounded jerk), it is over as long after a reading as one eight times as far lies
    before it.
    """
    farther = np.flatnonzero(away >= _CUBE * away[0])
    over = 2.0 * t[0] - t[farther[0]] if farther.size else t[0] + between[2]
    if over >= resting - between[0]:
        return t[:0]
    count = min(between.size, int((resting - over) / between[0]))
    return over + np.geomspace(between[0], resting - over, count + 1)[:-1] - between[0]


def _simplest(
    knots: Array, left: float | None, right: float | None, window: Window, tol: Tolerance
) -> Joints:
    """Return the first choice of joints that agrees with the readings.

    In order: smooth; kinks between the long pieces only; smooth with one or two more knots than
    the segments have; kinks throughout. If none is faithful, the one with the smallest largest
    residual. The looser bound for the smooth choices is there because a knot too many costs more
    than a residual of one step.
    """
    many = np.diff(np.searchsorted(window.time, knots)) >= _FEWEST_PER_PIECE
    long = np.concatenate([[True], many[:-1] & many[1:], [True]])
    smooth_start = Joints(knots, np.zeros(knots.size, dtype=bool), left, right)
    best = optimise(smooth_start, window)
    least = _worst(best, window, tol)
    if least <= tol.rest and _fewest_samples(best, window) >= _FEWEST_RESOLVED:
        return best
    merged = Joints(knots[long], np.ones(int(long.sum()), dtype=bool), left, right)
    trial = optimise(merged, window)
    if _worst(trial, window, tol) <= tol.sample:
        return trial
    trial = best
    for _ in range(_EXTRA_KNOTS):
        if least <= tol.rest or trial.knots.size > _FEW_KNOTS:
            break
        trial = optimise(with_knot_at_worst(trial, window, tol), window)
        if (worst := _worst(trial, window, tol)) < least:
            best, least = trial, worst
    if least <= tol.rest and _fewest_samples(best, window) >= _FEWEST_RESOLVED:
        return best
    trial = optimise(replace(smooth_start, kinked=np.ones(knots.size, dtype=bool)), window)
    return trial if _worst(trial, window, tol) < max(least, tol.sample) else best


def _worth(joints: Joints, window: Window, tol: Tolerance) -> Joints:
    """Remove and add knots by the gain in squared residuals against the cost of their parameters.

    Where readings scatter, several may each be off by less than scatter could make, and all
    together by more. A knot, and a kink, must lower the squares by 2 ln n variances for each of
    its numbers, as the best of n positions fits more of the scatter than a given one does (Zhang &
    Siegmund 2007). No path is asked to be better than the floor.
    """
    if tol.noise == 0.0:
        return joints
    number = 2.0 * max(tol.variance, tol.floor**2) * float(np.log(window.time.size))
    joints = _spared(joints, window, tol, number)
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


def _spared(joints: Joints, window: Window, tol: Tolerance, number: float) -> Joints:
    """Remove knots that the readings do not support, as scatter may divide a piece."""
    while 2 < joints.knots.size <= _FEW_KNOTS:
        trials = [
            optimise(replace(joints, knots=knots, kinked=kinked), window)
            for k in range(1, joints.knots.size - 1)
            for knots, kinked in [(np.delete(joints.knots, k), np.delete(joints.kinked, k))]
        ]
        best = min(trials, key=lambda trial: _squares(trial, window))
        lost = _squares(best, window) - _squares(joints, window)
        if lost >= 2.0 * number or _worst(best, window, tol) > tol.rest:
            break
        joints = best
    return joints


def _squares(joints: Joints, window: Window) -> float:
    return float(np.sum(residuals(joints, window.time, window.displacement) ** 2))


def _worst(joints: Joints, window: Window, tol: Tolerance) -> float:
    """Return the largest residual, or that of a run of readings scaled to its bound."""
    off = residuals(joints, window.time, window.displacement)
    return tol.rest * float(excess(off, tol, tol.rest).max())


def _fewest_samples(joints: Joints, window: Window) -> int:
    return int(np.diff(np.searchsorted(window.time, joints.knots)).min())
