"""Least-squares quintic splines with knots where the residuals need them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.motion.bounds import Tolerance, excess
from qlvbayes.motion.splines import Joints, Spline, Window
from qlvbayes.motion.splines import fit as fitted_spline

Array = NDArray[np.float64]

DEGREE = 5
_FEWEST = 2  # samples in a span that may not be halved further
_MANY = 16  # samples in a span that is halved because all together leave too much
_LITTLE = 0.1  # of the readings' variance: less is not worth more knots
_ROUNDS = 24  # of halving: enough for 2^24 readings
_SURE = 3.0  # sds by which a span's mean square must exceed its expectation


def fit(joints: Joints, window: Window) -> Spline:
    """Return the spline on these joints that minimises the squared residuals."""
    return fitted_spline(joints, window.time, window.displacement, DEGREE)


def refined(joints: Joints, window: Window, tol: Tolerance) -> tuple[Spline, bool]:
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


def unfaithful(spline: Spline, window: Window, tol: Tolerance) -> NDArray[np.bool_]:
    """Return the spans (k,) whose residuals exceed what the readings' errors explain.

    Rounding of a slow motion repeats itself from sample to sample: only a change of reading counts
    as a reading of its own. What no single span shows may show in all of them together.
    """
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
