r"""Paths through few readings, without features that the readings do not show.

`trapezoid`: controllers make a move from rest to rest by a trapezoid of velocity. With the share s
= (t - t_0) / T of its duration and the share r of speeding up and slowing down, a stroke D is

.. math:: x = x_0 + D \begin{cases} s^2 / 2r(1 - r) & s < r \\ (s - r/2) / (1 - r) & \\
          1 - (1 - s)^2 / 2r(1 - r) & s > 1 - r \end{cases}

Where the readings leave one of the three numbers open, the least acceleration is taken.

`monotone`: cubics that rise and fall where the readings do (Fritsch & Butland 1984,
doi:10.1137/0905021). `corners`: straight lines that are never far from them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator, PPoly
from scipy.optimize import least_squares

from qlvbayes.io.arrays import Array
from qlvbayes.motion.splines import Joints, Window

_SHARES = (0.5, *np.geomspace(0.48, 1e-3, 24))  # r, from a triangle to hardly more than a line
_MOVED = 1e-3  # of the stroke, from which a reading is taken to be in motion


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


def monotone(time: Array, displacement: Array, *, rests: tuple[bool, bool]) -> PPoly:
    """Return cubics through readings (n,), n >= 2; rests: whether the platen rests at each end."""
    before, after = 2.0 * time[0] - time[1], 2.0 * time[-1] - time[-2]
    first, last = (slice(0, 1), slice(-1, None))
    times = [np.array([before])[: int(rests[0])], time, np.array([after])[: int(rests[1])]]
    values = [
        displacement[first][: int(rests[0])],
        displacement,
        displacement[last][: int(rests[1])],
    ]
    with np.errstate(over="ignore"):  # over a step of next to nothing: the slope is 0 there
        path = PchipInterpolator(np.concatenate(times), np.concatenate(values))
    return PPoly(path.c[:, int(rests[0]) : int(rests[0]) + time.size - 1], time)


def strays_between(path_at: Array, path_between: Array, readings: Array, most: float) -> Array:
    """Return where (n - 1,) a path leaves the range of two readings."""
    moves = np.diff(readings)
    moves[np.abs(moves) <= most] = 0.0
    before, after = np.append(0.0, moves[:-1]), np.append(moves[1:], 0.0)
    turning = (before * moves < 0.0) | (moves * after < 0.0) | (before * after < 0.0)
    ends = np.stack([readings[:-1], readings[1:], path_at[:-1], path_at[1:]])
    above = path_between.max(axis=1) - ends.max(axis=0)
    below = ends.min(axis=0) - path_between.min(axis=1)
    return (np.maximum(above, below) > most) & ~turning


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
