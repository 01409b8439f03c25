"""Least-squares quintic splines with knots where the residuals need them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance, excess
from qlvbayes.motion.fewreadings import changes
from qlvbayes.motion.splines import FittedSpline, Joints, Stretch, Window
from qlvbayes.motion.splines import fit as fitted_spline

DEGREE = 5
_FEWEST = 2  # samples in a span that may not be halved further
_MANY = 16  # samples in a span that is halved because all together leave too much
_LITTLE = 0.1  # of the readings' variance: less is not worth more knots
_ROUNDS = 24  # of halving: enough for 2^24 readings
_INWARD = 0.8  # of the first span: how far an end may move into it
_SURE = 3.0  # sds by which a span's mean square must exceed its expectation


def fit(joints: Joints, window: Window) -> FittedSpline:
    """Return the spline on these joints that minimises the squared residuals."""
    return fitted_spline(joints, window.time, window.displacement, DEGREE)


def smooth(ends: Joints, window: Window, tol: Tolerance) -> Stretch | None:
    """Return a quintic spline between dwells, or None if none agrees with the readings."""
    spline, faithful = refined(ends, window, tol)
    if ends.left is not None or ends.right is not None:
        for side in (0, -1):
            spline = _with_better_end(spline, side, window)
        ends = Joints(
            spline.joints.knots[[0, -1]], spline.joints.kinked[[0, -1]], ends.left, ends.right
        )
        spline, faithful = refined(ends, window, tol)
    if not faithful or _wanders(spline, window, tol):
        return None
    return Stretch(window, spline.joints, DEGREE, spline.pieces(), spline.parameters)


def _wanders(spline: FittedSpline, window: Window, tol: Tolerance) -> bool:
    """Return whether a path deviates from the line between readings by more than their change."""
    time, x = window.time, window.displacement
    inside = (time >= spline.joints.knots[0]) & (time <= spline.joints.knots[-1])
    time, x = time[inside], x[inside]
    if time.size < 2:
        return False
    middle = 0.5 * (time[1:] + time[:-1])
    off = spline.displacement(middle) - 0.5 * (x[1:] + x[:-1])
    return bool(np.any(np.abs(off) > changes(x) + 2.0 * tol.rest))


def _with_better_end(spline: FittedSpline, side: int, window: Window) -> FittedSpline:
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
        return float(np.sum(fit(_local(joints, side, end), part).residuals ** 2))

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


def refined(joints: Joints, window: Window, tol: Tolerance) -> tuple[FittedSpline, bool]:
    """Halve spans until all agree with the readings; return the fit and whether all do."""
    spline = fit(joints, window)
    for _ in range(_ROUNDS):
        failing = unfaithful(spline, window, tol)
        if not failing.any():
            return spline, True
        halved = _halved(spline.joints, window.time, failing)
        if halved is None:
            break
        spline = fit(halved, window)
    return spline, False


def unfaithful(spline: FittedSpline, window: Window, tol: Tolerance) -> NDArray[np.bool_]:
    """Return the spans (k,) whose residuals exceed what the readings' errors explain."""
    knots, r = spline.joints.knots, spline.residuals
    count = knots.size - 1
    span = np.clip(np.searchsorted(knots, window.time, side="right") - 1, 0, count - 1)
    samples = np.bincount(span, minlength=count)
    changes = np.append(window.displacement[1:] != window.displacement[:-1], True)
    own = np.maximum(np.bincount(span, weights=changes, minlength=count), 1.0)
    square = np.bincount(span, weights=r * r, minlength=count) / np.maximum(samples, 1)
    most, least = np.zeros(count), np.zeros(count)
    np.maximum.at(most, span, r)
    np.minimum.at(least, span, r)
    far = (np.maximum(most, -least) > tol.sample) & (most - least > 1.25 * tol.step)
    far[span[excess(r, tol, np.inf) > 1.0]] = True
    loud = square > tol.variance * (1.0 + _SURE * np.sqrt(2.0 / own))
    failing = far | (loud & (samples >= 2 * _FEWEST))
    beyond = max(_LITTLE, _SURE * float(np.sqrt(2.0 / own.sum())))
    if not failing.any() and np.mean(r * r) > tol.variance * (1.0 + beyond):
        failing = (square > tol.variance) & (samples >= _MANY)
    return failing


def _halved(joints: Joints, time: Array, failing: NDArray[np.bool_]) -> Joints | None:
    """Return joints with a knot in the middle of each failing span; None if one has few samples."""
    knots = [joints.knots]
    for k in np.flatnonzero(failing):
        i, j = np.searchsorted(time, joints.knots[k : k + 2])
        if j - i < 2 * _FEWEST:
            return None
        middle = (i + j) // 2
        knots.append(np.array([0.5 * (time[middle - 1] + time[middle])]))
    knots_after = np.sort(np.concatenate(knots))
    kinked = np.zeros(knots_after.size, dtype=bool)
    kinked[0], kinked[-1] = joints.kinked[0], joints.kinked[-1]
    return replace(joints, knots=knots_after, kinked=kinked)
