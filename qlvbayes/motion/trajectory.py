"""Displacement, velocity and acceleration of the platen, from its encoder record or as planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.motion.bounds import (
    Departure,
    DwellSpan,
    Tolerance,
    departure_of,
    find_dwells,
    greedy_segments,
)
from qlvbayes.motion.errors import Errors, errors, moments
from qlvbayes.motion.sensor import clock_error, encoder_step, scatter_left, tolerance
from qlvbayes.motion.splines import Stretch, at_ends
from qlvbayes.motion.stretch import fitted

_SPEED_KNOWN = 0.05  # of the top speed: largest median error of a known velocity,
_ACCELERATION_KNOWN = 0.2  # and the same for the acceleration
_JUMPS = 0.5  # share of the changes of velocity that are too quick to be resolved
_EXACT = 1e-6  # of the range: no record is better than that
_FREEDOM = 10  # readings in motion for each knot, at which residuals show errors
_SAME = 1e-6  # of the largest: smaller jumps are rounding
_TRIALS = 5  # fits at most, each with the scatter that the one before it left,
_LESS = 0.7  # if that is less than so much of what was assumed


@dataclass(frozen=True)
class Trajectory:
    """A continuous motion, a polynomial between each two knots t_k and t_{k+1}.

    delta(t) = d_k + v_k s + a_k s^2 / 2 + sum_j h_jk s^(3 + j), s = t - t_k, t_k <= t < t_{k+1}.

    ``knots`` (k+1,) in s; ``start_displacement``, ``start_velocity``, ``start_acceleration`` (k,)
    in mm, mm/s, mm/s2 (or strain, 1/s, 1/s2); ``resolution`` the encoder step in units of
    displacement, 0 if none was seen; ``higher`` (m, k) the h_jk, None for constant accelerations.
    Outside the record the motion is at rest at its end value. At a kink the velocity and
    acceleration are those just after it. ``unresolved``: what the record cannot give ("velocity",
    "acceleration"), with the reason in a few words. ``moments``: times of knots and their sds in s.
    ``clock_sd``: sd in s of the error of each reading's time stamp, from the jitter of the clock
    and the rounding of the stamps (``clock.clock_error``), and no more than the readings of the
    moving platen allow; 0 where stamps are exact or none were read. ``read_at``: times (n,) of the
    readings, None for a planned motion; ``departure``: where the path is farthest from readings, if
    that is more than two resolutions and more than their scatter explains.
    """

    knots: Array
    start_displacement: Array
    start_velocity: Array
    start_acceleration: Array
    resolution: float
    higher: Array | None = None
    unresolved: tuple[tuple[str, str], ...] = ()
    error: Errors | None = None
    moments: tuple[Array, Array] | None = None
    clock_sd: float = 0.0
    read_at: Array | None = None
    departure: Departure | None = None

    @cached_property
    def _path(self) -> tuple[PPoly, PPoly, PPoly]:
        rows = [0.5 * self.start_acceleration, self.start_velocity, self.start_displacement]
        higher = [] if self.higher is None else list(self.higher[::-1])
        path = PPoly(np.array([*higher, *rows]), self.knots)
        return path, path.derivative(1), path.derivative(2)

    @property
    def path(self) -> PPoly:
        """Motion from the first knot to the last as a piecewise polynomial of time."""
        return self._path[0]

    @cached_property
    def _jumps(self) -> tuple[Array, Array]:
        """Sizes (k-1,) of the jumps of velocity and acceleration at the inner knots."""
        _, velocity, acceleration = self._path
        jumps = []
        for poly, most in ((velocity, self.top_speed), (acceleration, self.top_acceleration)):
            jump = np.abs(poly.c[-1, 1:] - at_ends(poly)[:-1])
            jumps.append(np.where(jump > _SAME * max(most, 1e-300), jump, 0.0))
        return jumps[0], jumps[1]

    @property
    def kinks(self) -> Array:
        """Times (j,) at which the velocity or the acceleration jumps."""
        return self.knots[1:-1][self._at_kinks]

    @property
    def speed_jumps(self) -> Array:
        """Size (j,) of the jump of velocity at each kink."""
        return self._jumps[0][self._at_kinks]

    @property
    def kink_sd(self) -> Array:
        """Sd (j,) in s of the time of each kink, from the readings' errors and spacing."""
        if self.moments is None:
            return np.zeros(self.kinks.shape)
        return np.asarray(np.interp(self.kinks, *self.moments))

    @property
    def _at_kinks(self) -> NDArray[np.bool_]:
        return (self._jumps[0] > 0.0) | (self._jumps[1] > 0.0)

    @cached_property
    def top_speed(self) -> float:
        """Largest speed."""
        return _largest(self._path[1], self._path[2])

    @cached_property
    def top_acceleration(self) -> float:
        """Largest magnitude of the acceleration; 0 where only straight lines were resolved."""
        return _largest(self._path[2], self._path[2].derivative(1))

    @cached_property
    def turning_points(self) -> Array:
        """Times between the knots at which the motion reverses."""
        roots = self._path[1].roots(discontinuity=False, extrapolate=False)
        return np.asarray(roots[np.isfinite(roots)])

    def read_times(self, time: Array) -> Array:
        """Return the times (n,) of the readings of displacement; ``time`` if none were read."""
        return time if self.read_at is None else self.read_at

    @property
    def velocity_resolved(self) -> bool:
        """True if the record gives the velocity."""
        return "velocity" not in dict(self.unresolved)

    @property
    def acceleration_resolved(self) -> bool:
        """True if the record gives the acceleration."""
        return "acceleration" not in dict(self.unresolved)

    def _at(self, order: int, t: ArrayLike) -> Array:
        asked = np.asarray(t, dtype=np.float64)
        clipped = np.clip(asked, self.knots[0], self.knots[-1])
        value = np.asarray(self._path[order](clipped))
        if order == 0:
            return value
        inside = (asked >= self.knots[0]) & (asked <= self.knots[-1])
        return np.where(inside, value, 0.0)

    def displacement(self, t: ArrayLike) -> Array:
        """Return the displacement at times ``t`` (any shape)."""
        return self._at(0, t)

    def velocity(self, t: ArrayLike) -> Array:
        """Return the velocity at times ``t`` (any shape); 0 outside the record."""
        return self._at(1, t)

    def acceleration(self, t: ArrayLike) -> Array:
        """Return the acceleration at times ``t`` (any shape); 0 outside the record."""
        return self._at(2, t)

    def displacement_sd(self, t: ArrayLike) -> Array:
        """Return the sd of ``displacement(t)`` (any shape), in units of displacement."""
        asked = np.asarray(t, dtype=np.float64)
        if self.error is None:
            return np.zeros(asked.shape)
        return np.asarray(np.interp(asked, self.error.time, self.error.displacement))


def _largest(poly: PPoly, slope: PPoly) -> float:
    """Return the largest magnitude of a piecewise polynomial whose derivative is given."""
    ends = [poly.c[-1], at_ends(poly)]
    if poly.c.shape[0] > 2:
        roots = slope.roots(discontinuity=False, extrapolate=False)
        ends.append(poly(roots[np.isfinite(roots)]))
    return float(max(np.max(np.abs(e), initial=0.0) for e in ends))


def smooth(
    time: ArrayLike,
    displacement: ArrayLike,
    resolution: float | None = None,
    scatter: float = np.inf,
) -> Trajectory:
    """Return the motion that an encoder recorded: few pieces, in agreement with every reading."""
    t = np.asarray(time, dtype=np.float64)
    x = np.asarray(displacement, dtype=np.float64)
    _check(t, x)
    step = encoder_step(x) if resolution is None else float(resolution)
    for _ in range(_TRIALS):
        tol = tolerance(t, x, step, scatter)
        segments = greedy_segments(t, x, tol)
        dwells = find_dwells(t, x, segments, tol)
        parts = _stretches(t, x, segments, dwells, tol)
        path = _joined(t, parts, dwells, tol)
        scatter = scatter_left(x - path.displacement(t), x, path.knots.size, tol)
        if scatter >= _LESS * tol.noise:
            break
    return _with_errors(t, x, path, parts, dwells, tol)


def _check(time: Array, displacement: Array) -> None:
    if time.ndim != 1 or time.shape != displacement.shape:
        raise InputError("time and displacement differ in length")
    if time.size < 2:
        raise InputError("a motion needs at least two readings")
    if not (np.all(np.isfinite(time)) and np.all(np.isfinite(displacement))):
        raise InputError("time or displacement is not finite")
    if np.any(np.diff(time) <= 0.0):
        raise InputError("time does not increase")


def _stretches(
    t: Array, x: Array, segments: list[tuple[int, int]], dwells: list[DwellSpan], tol: Tolerance
) -> list[Stretch]:
    """Fit the motion between the dwells."""
    return [
        fitted(t, x, segments, before, after, tol)
        for before, after in pairwise([None, *dwells, None])
        if before or after is None or after.first > 0
        if after or before is None or before.stop < t.size
    ]


def _joined(t: Array, parts: list[Stretch], dwells: list[DwellSpan], tol: Tolerance) -> Trajectory:
    """Put moving parts and dwells in order of time."""
    most = max((len(part.pieces.c) for part in parts), default=3)
    starts = [part.pieces.x[:-1] for part in parts]
    values = [np.pad(p.pieces.c, ((most - len(p.pieces.c), 0), (0, 0))) for p in parts]
    for dwell in dwells:
        into = [p.pieces.x[-1] for p in parts if p.pieces.x[-1] <= t[dwell.stop - 1]]
        starts.append(np.array([max(into) if into and dwell.first > 0 else t[0]]))
        values.append(np.pad([[dwell.level]], ((most - 1, 0), (0, 0))))
    knots = np.concatenate(starts)
    order = np.argsort(knots, kind="stable")
    path = PPoly(np.concatenate(values, axis=1)[:, order], np.append(knots[order], t[-1]))
    *higher, bend, speed, level = path.c
    return Trajectory(
        path.x, level, speed, 2.0 * bend, tol.step, np.array(higher[::-1]) if higher else None
    )


def _with_errors(
    t: Array,
    x: Array,
    path: Trajectory,
    parts: list[Stretch],
    dwells: list[DwellSpan],
    tol: Tolerance,
) -> Trajectory:
    """Return the path with its errors, as far as the readings determine them."""
    part_errors = [errors(part, tol) for part in parts]
    clock = _clock_sd(t, x, path)
    return replace(
        path,
        error=_all_errors(t, parts, part_errors, dwells, tol),
        unresolved=_unresolved(path, parts, part_errors),
        moments=_all_moments(t, parts, dwells, tol, clock),
        clock_sd=clock,
        read_at=t,
        departure=departure_of(t, x - path.displacement(t), tol),
    )


def _clock_sd(t: Array, x: Array, motion: Trajectory) -> float:
    """Return the sd of the stamps, bounded by the residuals of the moving platen's readings."""
    speed = motion.velocity(t)
    stamped = clock_error(t)
    if stamped == 0.0 or _FREEDOM * motion.knots.size > np.count_nonzero(speed):
        return stamped  # a path that follows each reading shows none of its errors
    off = x - motion.displacement(t)
    weight = np.abs(speed)
    return min(stamped, float(np.sqrt(np.sum(weight * off**2) / np.sum(weight**3))))


def _all_moments(
    t: Array, parts: list[Stretch], dwells: list[DwellSpan], tol: Tolerance, clock: float
) -> tuple[Array, Array]:
    """Return the times of all stretches' knots and their sds, in order of time."""
    every = [(t[[0, -1]], np.zeros(2))]
    for part in parts:
        begin, end = part.joints.knots[[0, -1]]
        before = [_level_sd(dwell, tol) for dwell in dwells if t[dwell.first] < begin]
        after = [_level_sd(dwell, tol) for dwell in dwells if t[dwell.stop - 1] > end]
        levels = (before[-1] if before else 0.0, after[0] if after else 0.0)
        every.append((part.joints.knots, moments(part, tol, levels, clock)))
    time, sd = _in_order(every)
    return time, sd


def _level_sd(dwell: DwellSpan, tol: Tolerance) -> float:
    """Sd of a dwell's level. At rest the rounding is not averaged out, unless scatter does it."""
    rounding = tol.step**2 / 12.0 if tol.noise < 0.5 * tol.step else 0.0
    return float(np.sqrt(tol.noise**2 / (dwell.stop - dwell.first) + rounding))


def _all_errors(
    t: Array,
    parts: list[Stretch],
    part_errors: list[Errors],
    dwells: list[DwellSpan],
    tol: Tolerance,
) -> Errors:
    """Return the errors of stretches and dwells, in order of time."""
    begins = np.array([p.joints.knots[0] for p in parts] + [t[-1]])
    ends = np.array([t[0]] + [p.joints.knots[-1] for p in parts])
    every = list(part_errors)
    for dwell in dwells:
        middle = 0.5 * (t[dwell.first] + t[dwell.stop - 1])
        span = np.array([ends[ends <= middle].max(), begins[begins >= middle].min()])
        every.append(Errors(span, np.full(2, _level_sd(dwell, tol)), np.zeros(2), np.zeros(2)))
    joined = Errors(*_in_order(every))
    least = max((float(np.ptp(p.window.displacement)) for p in parts), default=0.0)
    return joined._replace(displacement=np.maximum(joined.displacement, _EXACT * least))


def _in_order(parts: Sequence[tuple[Array, ...]]) -> list[Array]:
    """Return columns of several parts as one, in order of the first one, time."""
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(columns[0], kind="stable")
    return [column[order] for column in columns]


def _unresolved(
    motion: Trajectory, parts: list[Stretch], part_errors: list[Errors]
) -> tuple[tuple[str, str], ...]:
    """Return why the readings do not determine velocity or acceleration."""
    if not parts:
        return (("velocity", "the platen never moves"), ("acceleration", "the platen never moves"))
    doubts = []
    every = Errors(*_in_order(part_errors))
    speed = _share(every.velocity, motion.velocity(every.time))
    if speed > _SPEED_KNOWN:
        doubts.append(("velocity", "the displacement record does not give the speed"))
    rate = _share(every.acceleration, motion.acceleration(every.time))
    jumps = float(np.sum(motion.speed_jumps))
    smoothly = float(np.sum(np.abs(np.diff(motion.start_velocity)))) - jumps
    if rate > _ACCELERATION_KNOWN or (jumps > 0.0 and jumps > _JUMPS * (jumps + smoothly)):
        doubts.append(("acceleration", "the displacement record does not give the acceleration"))
    return tuple(doubts)


def _share(sds: Array, values: Array) -> float:
    """Return the median sd over the largest value, each weighted by the square of its value."""
    most = float(np.max(np.abs(values)))
    if most == 0.0:
        return np.inf
    order = np.argsort(sds)
    weight = np.cumsum(values[order] ** 2)
    return float(sds[order][np.searchsorted(weight, 0.5 * weight[-1])]) / most


@dataclass(frozen=True)
class Stroke:
    """A movement to ``target`` no faster than ``speed``, followed by a hold of ``hold`` seconds."""

    target: float
    speed: float
    hold: float


def planned(strokes: Sequence[Stroke], acceleration: float) -> Trajectory:
    """Return the motion of some strokes from zero displacement, each a trapezoid of velocity."""
    pieces: list[tuple[float, float, float]] = []  # duration, velocity at the start, acceleration
    position = 0.0
    for stroke in strokes:
        length = stroke.target - position
        position = stroke.target
        if length:
            pieces += _trapezoid(abs(length), stroke.speed, acceleration, np.sign(length))
        if stroke.hold > 0.0:
            pieces.append((stroke.hold, 0.0, 0.0))
    duration, velocity, rate = np.array(pieces).T
    knots = np.concatenate([[0.0], np.cumsum(duration)])
    gained = duration * (velocity + 0.5 * rate * duration)
    start = np.concatenate([[0.0], np.cumsum(gained)[:-1]])
    return Trajectory(knots, start, velocity, rate, 0.0)


def _trapezoid(
    length: float, speed: float, acceleration: float, sign: float
) -> list[tuple[float, float, float]]:
    top = min(speed, sqrt(acceleration * length))
    rise = top / acceleration
    cruise = length / top - rise
    cruising = [(cruise, sign * top, 0.0)] if cruise > 1e-12 * rise else []
    return [(rise, 0.0, sign * acceleration), *cruising, (rise, sign * top, -sign * acceleration)]
