"""Least-squares quintic splines with knots where the residuals need them.

Between knots the displacement is a polynomial of degree 5; at a knot four derivatives are
continuous. An end may be joined to a dwell: there the level is given and the velocity is 0 unless
that end is kinked. B-splines and their least squares:
de Boor, A Practical Guide to Splines, 2001, chapters IX and XIV.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly
from scipy.linalg import solveh_banded
from scipy.sparse import csr_array

from qlvbayes.motion.bounds import Tolerance, excess
from qlvbayes.motion.freeknots import PULL, Joints, Pieces, Window

Array = NDArray[np.float64]

DEGREE = 5
_FEWEST = 2  # samples in a span that may not be halved further
_MANY = 16  # samples in a span that is halved because all together leave too much
_LITTLE = 0.1  # of the readings' variance: less is not worth more knots
_ROUNDS = 24  # of halving: enough for 2^24 readings
_SURE = 3.0  # sds by which a span's mean square must exceed its expectation
_BETWEEN = np.linspace(0.0, 1.0, DEGREE + 1)[None]  # points of a span
_ROUNDOFF = 1e-11  # of the normal matrix, so that it can be inverted


@dataclass(frozen=True)
class Quintic:
    """A fitted spline: joints, coefficients of its B-splines, residuals of the window's samples."""

    joints: Joints
    full: Array
    coefficients: Array
    residuals: Array

    @property
    def parameters(self) -> int:
        """Number of free coefficients."""
        return self.coefficients.size - sum(_fixed(self.joints))


def fit(joints: Joints, window: Window) -> Quintic:
    """Return the spline on these joints that minimises the squared residuals."""
    full = full_knots(joints)
    basis = design(full, window.time, joints)
    origin = float(window.displacement[0])
    y = window.displacement - origin
    low, high = _fixed(joints)
    size = full.size - DEGREE - 1
    c = np.zeros(size)
    c[:low] = 0.0 if joints.left is None else joints.left - origin
    c[size - high :] = 0.0 if joints.right is None else joints.right - origin
    free = slice(low, size - high)
    if size - high > low:
        knots = joints.knots
        between = (knots[:-1, None] + np.diff(knots)[:, None] * _BETWEEN).ravel()
        pulled = design(full, between, joints)
        lines = np.interp(between, window.time, y)
        inner, weak = basis[:, free], PULL * pulled[:, free]
        band = banded_gram(inner) + banded_gram(pulled[:, free]) * PULL
        right_side = inner.T @ (y - basis @ c) + weak.T @ (lines - pulled @ c)
        c[free] = solveh_banded(band, right_side, check_finite=False)
    return Quintic(joints, full, c + origin, y - basis @ c)


def displacement(spline: Quintic, time: Array) -> Array:
    """Return the displacement at times (n,) between the ends."""
    return np.asarray(design(spline.full, time, spline.joints) @ spline.coefficients)


def full_knots(joints: Joints) -> Array:
    """Return the knots with their multiplicity, 6 at the ends."""
    return np.pad(joints.knots, DEGREE, mode="edge")


def design(full: Array, time: Array, joints: Joints) -> csr_array:
    """Return the B-splines at some times (n, coefficients), constant beyond the ends."""
    inside = np.clip(time, joints.knots[0], joints.knots[-1])
    return csr_array(BSpline.design_matrix(inside, full, DEGREE))


def banded_gram(basis: csr_array) -> Array:
    """Return the upper banded form (6, size) of basis^T basis."""
    gram = (basis.T @ basis).todia()
    size = basis.shape[1]
    band = np.zeros((DEGREE + 1, size))
    for offset, diagonal in zip(gram.offsets, gram.data, strict=True):
        if 0 <= offset <= DEGREE:
            band[DEGREE - offset, : diagonal.size] = diagonal[:size]
    band[DEGREE] += _ROUNDOFF * max(float(band[DEGREE].max()), 1e-300)
    return band


def pieces(spline: Quintic) -> Pieces:
    """Return the spline as a polynomial between each two knots."""
    poly = PPoly.from_spline(BSpline(spline.full, spline.coefficients, DEGREE))
    real = np.diff(poly.x) > 0.0
    rising = poly.c[::-1, real]
    knots = np.append(poly.x[:-1][real], poly.x[-1])
    return Pieces(knots, rising[0], rising[1], 2.0 * rising[2], rising[3:])


def refined(joints: Joints, window: Window, tol: Tolerance) -> tuple[Quintic, bool]:
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


def unfaithful(spline: Quintic, window: Window, tol: Tolerance) -> NDArray[np.bool_]:
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


def _fixed(joints: Joints) -> tuple[int, int]:
    """Return how many coefficients the dwells determine at either end."""
    low = 0 if joints.left is None else (1 if joints.kinked[0] else 2)
    high = 0 if joints.right is None else (1 if joints.kinked[-1] else 2)
    return low, high


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
