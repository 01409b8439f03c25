"""Displacement, velocity and acceleration of the platen from its encoder record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from qlvbayes.checks import InputError
from qlvbayes.kinematics.freeknots import (
    MOST_FREE_KNOTS,
    Joints,
    Pieces,
    Window,
    insert_until_faithful,
    optimise,
    pieces,
    residuals,
    with_knot_at_worst,
)
from qlvbayes.kinematics.segments import (
    Rest,
    Tolerance,
    encoder_step,
    find_rests,
    greedy_segments,
    tolerance,
)

Array = NDArray[np.float64]

_FEWEST_PER_PIECE = 5
_FEWEST_RESOLVED = 3  # samples that show an acceleration
_EXTRA_KNOTS = 2


@dataclass(frozen=True)
class Trajectory:
    """A continuous motion of constant acceleration a_k between knots t_k and t_{k+1}.

    delta(t) = d_k + v_k (t - t_k) + a_k (t - t_k)^2 / 2 for t_k <= t < t_{k+1}.

    ``knots`` (k+1,) in s; ``start_displacement``, ``start_velocity``, ``start_acceleration`` (k,)
    in mm, mm/s, mm/s2 (or strain, 1/s, 1/s2); ``resolution`` the encoder step in units of
    displacement, 0 if none was seen. Outside the record the motion is at rest at its end value.
    At a kink the velocity and acceleration are those just after it.
    """

    knots: Array
    start_displacement: Array
    start_velocity: Array
    start_acceleration: Array
    resolution: float

    @property
    def kinks(self) -> Array:
        """Times (k-1,) at which the velocity or the acceleration jumps."""
        return self.knots[1:-1]

    @property
    def speed_jumps(self) -> Array:
        """Size (k-1,) of the jump of velocity at each inner knot: changes too quick to resolve."""
        ends = self.start_velocity + np.diff(self.knots) * self.start_acceleration
        jumps = np.abs(self.start_velocity[1:] - ends[:-1])
        return np.where(jumps > 1e-9 * max(self.top_speed, 1e-300), jumps, 0.0)

    @property
    def top_speed(self) -> float:
        """Largest speed."""
        last = self.start_velocity + np.diff(self.knots) * self.start_acceleration
        return float(max(np.max(np.abs(self.start_velocity)), np.max(np.abs(last))))

    @property
    def top_acceleration(self) -> float:
        """Largest magnitude of the acceleration; 0 where only straight lines were resolved."""
        return float(np.max(np.abs(self.start_acceleration)))

    def _locate(self, t: ArrayLike) -> tuple[NDArray[np.intp], Array, NDArray[np.bool_]]:
        asked = np.asarray(t, dtype=np.float64)
        inside = np.asarray((asked >= self.knots[0]) & (asked <= self.knots[-1]))
        clipped = np.clip(asked, self.knots[0], self.knots[-1])
        piece = np.asarray(np.searchsorted(self.knots[1:-1], clipped, side="right"))
        return piece, np.asarray(clipped - self.knots[piece]), inside

    def displacement(self, t: ArrayLike) -> Array:
        """Displacement at times ``t`` (any shape)."""
        k, s, _ = self._locate(t)
        return np.asarray(
            self.start_displacement[k]
            + s * (self.start_velocity[k] + 0.5 * s * self.start_acceleration[k])
        )

    def velocity(self, t: ArrayLike) -> Array:
        """Velocity at times ``t`` (any shape); 0 outside the record."""
        k, s, inside = self._locate(t)
        return np.where(inside, self.start_velocity[k] + s * self.start_acceleration[k], 0.0)

    def displacement_sd(self, t: ArrayLike) -> Array:
        """Sd of the displacement's error at times ``t``: resolution/sqrt(12), 0 at rest."""
        moving = (self.velocity(t) != 0.0) | (self.acceleration(t) != 0.0)
        return np.where(moving, self.resolution / np.sqrt(12.0), 0.0)

    def acceleration(self, t: ArrayLike) -> Array:
        """Acceleration at times ``t`` (any shape); 0 outside the record."""
        k, _, inside = self._locate(t)
        return np.where(inside, self.start_acceleration[k], 0.0)


def smooth(time: ArrayLike, displacement: ArrayLike, resolution: float | None = None) -> Trajectory:
    """Return the motion behind an encoder record: few pieces, faithful to every reading.

    Rests come out exactly constant. Each stretch between rests becomes a quadratic spline with
    knots where least squares puts them, as few as keep all residuals within what the encoder step
    and the scatter explain; the velocity is continuous unless a change of it is too quick to be
    resolved by the samples. Where the record is too sparse for that the samples are joined by
    straight lines.

    Parameters
    ----------
    time, displacement
        (n,) readings, n >= 2, time increasing in s, evenly spaced or not.
    resolution
        Encoder step in units of displacement; found from the readings if None.

    Raises
    ------
    InputError
        Shapes differ, fewer than two readings, a reading not finite, time not increasing.
    """
    t = np.asarray(time, dtype=np.float64)
    x = np.asarray(displacement, dtype=np.float64)
    _check(t, x)
    step = encoder_step(x) if resolution is None else float(resolution)
    tol = tolerance(t, x, step)
    segments = greedy_segments(t, x, tol)
    rests = find_rests(t, x, segments, tol)
    return _assembled(t, x, segments, rests, tol)


def _check(time: Array, displacement: Array) -> None:
    if time.ndim != 1 or time.shape != displacement.shape:
        raise InputError("time and displacement differ in length")
    if time.size < 2:
        raise InputError("a motion needs at least two readings")
    if not (np.all(np.isfinite(time)) and np.all(np.isfinite(displacement))):
        raise InputError("time or displacement is not finite")
    if np.any(np.diff(time) <= 0.0):
        raise InputError("time does not increase")


def _assembled(
    t: Array, x: Array, segments: list[tuple[int, int]], rests: list[Rest], tol: Tolerance
) -> Trajectory:
    parts: list[Pieces] = []
    bounds = [None, *rests, None]
    for before, after in pairwise(bounds):
        if before is None and after is not None and after.first == 0:
            continue
        if after is None and before is not None and before.stop == t.size:
            continue
        parts.append(_stretch(t, x, segments, before, after, tol))
    return _joined(t, parts, rests, tol.step)


def _joined(t: Array, parts: list[Pieces], rests: list[Rest], step: float) -> Trajectory:
    """Put moving parts and rests in order of time."""
    starts: list[Array] = []
    values: list[Array] = []
    for part in parts:
        starts.append(part.knots[:-1])
        values.append(np.stack([part.displacement, part.velocity, part.acceleration]))
    for rest in rests:
        into = [p.knots[-1] for p in parts if p.knots[-1] <= t[rest.stop - 1]]
        starts.append(np.array([max(into) if into and rest.first > 0 else t[0]]))
        values.append(np.array([[rest.level], [0.0], [0.0]]))
    knots = np.concatenate(starts)
    order = np.argsort(knots, kind="stable")
    d, v, a = np.concatenate(values, axis=1)[:, order]
    return Trajectory(np.append(knots[order], t[-1]), d, v, a, step)


def _stretch(
    t: Array,
    x: Array,
    segments: list[tuple[int, int]],
    before: Rest | None,
    after: Rest | None,
    tol: Tolerance,
) -> Pieces:
    """Fit the motion between two rests (None: the record begins or ends in motion)."""
    first = 0 if before is None else before.stop
    stop = t.size if after is None else after.first
    low = first - 1 if before is not None else first
    high = stop if after is not None else stop - 1
    left, right = (r.level if r is not None else None for r in (before, after))
    window = _window(t, x, first, stop, before, after)
    if stop - first < 3:
        joints = Joints(t[low : high + 1], np.ones(high + 1 - low, dtype=bool), left, right)
        return pieces(joints, window)
    # The last piece of a record that ends in motion may be a leftover of a few samples.
    end = stop if after is not None else stop - _FEWEST_PER_PIECE
    cuts = [0.5 * (t[i - 1] + t[i]) for i, _ in segments if first < i < end]
    knots = np.array([t[low], *cuts, t[high]])
    joints = _simplest(knots, left, right, window, tol)
    return pieces(insert_until_faithful(joints, window, tol.rest), window)


def _window(
    t: Array, x: Array, first: int, stop: int, before: Rest | None, after: Rest | None
) -> Window:
    """Take in part of the rests beside a stretch, so that its end knots can move."""
    reach = max(20, (stop - first) // 4)
    i = first if before is None else first - min(reach, (before.stop - before.first) // 2)
    j = stop if after is None else stop + min(reach, (after.stop - after.first) // 2)
    return Window(t[i:j], x[i:j], float(t[i]), float(t[j - 1]))


def _simplest(
    knots: Array, left: float | None, right: float | None, window: Window, tol: Tolerance
) -> Joints:
    """Return the first faithful choice of joints.

    In order: smooth; kinks between the long pieces only; smooth with one or two more knots than
    the segments have; kinks throughout. If none is faithful, the one with the smallest largest
    residual. The looser bound for the smooth choices is there because a knot too many costs more
    than a residual of one step.
    """
    many = np.diff(np.searchsorted(window.time, knots)) >= _FEWEST_PER_PIECE
    long = np.concatenate([[True], many[:-1] & many[1:], [True]])
    smooth_start = Joints(knots, np.zeros(knots.size, dtype=bool), left, right)
    best = optimise(smooth_start, window)
    least = _worst(best, window)
    if least <= tol.rest and _fewest_samples(best, window) >= _FEWEST_RESOLVED:
        return best
    merged = Joints(knots[long], np.ones(int(long.sum()), dtype=bool), left, right)
    trial = optimise(merged, window)
    if _worst(trial, window) <= tol.sample:
        return trial
    trial = best
    for _ in range(_EXTRA_KNOTS):
        if least <= tol.rest or trial.knots.size > MOST_FREE_KNOTS:
            break
        trial = optimise(with_knot_at_worst(trial, window), window)
        if (worst := _worst(trial, window)) < least:
            best, least = trial, worst
    if least <= tol.rest and _fewest_samples(best, window) >= _FEWEST_RESOLVED:
        return best
    trial = optimise(replace(smooth_start, kinked=np.ones(knots.size, dtype=bool)), window)
    return trial if _worst(trial, window) < max(least, tol.sample) else best


def _worst(joints: Joints, window: Window) -> float:
    return float(np.abs(residuals(joints, window.time, window.displacement)).max())


def _fewest_samples(joints: Joints, window: Window) -> int:
    return int(np.diff(np.searchsorted(window.time, joints.knots)).min())
