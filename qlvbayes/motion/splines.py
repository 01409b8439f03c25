"""Least-squares splines that join dwells, on SciPy's B-splines, and smooth curves of degree 5.

Between knots the displacement is a polynomial of degree p. At a knot p - 1 derivatives are
continuous, at a kinked one the displacement alone. An end may be joined to a dwell: there the level
is given and the velocity is 0 unless that end is kinked. B-splines and their least squares: de
Boor, A Practical Guide to Splines, 2001, chapters IX and XIV. A smooth curve has knots where the
residuals need them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly
from scipy.linalg import solveh_banded
from scipy.optimize import minimize_scalar

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance, excess

Flags = NDArray[np.bool_]
Basis = tuple[NDArray[np.intp], Array]

_PULL = 1e-8  # weight, over a reading's, of lines between readings, for pieces without readings
_ROUNDOFF = 1e-14  # of the normal matrix, so that it can be inverted
_SMOOTH = 5  # degree of a smooth curve
_FEWEST = 2  # samples in a span that may not be halved further
_MANY = 16  # samples in a span that is halved because all together leave too much
_LITTLE = 0.1  # of the readings' variance: less is not worth more knots
_MOST_FAILING = 0.02  # of the spans of a long curve, which may be off by what `straying` allows
_ROUNDS = 24  # of halving: enough for 2^24 readings
_INWARD = 0.8  # of the first span: how far an end may move into it
_SURE = 3.0  # sds by which a span's mean square must exceed its expectation


@dataclass(frozen=True)
class Joints:
    """Knots, which of them carry a velocity jump, and the dwells at the ends (None: no dwell)."""

    knots: Array
    kinked: Flags
    left: float | None
    right: float | None


@dataclass(frozen=True)
class Window:
    """The samples of one stretch and how far its end knots may go."""

    time: Array
    displacement: Array
    earliest: float
    latest: float


@dataclass(frozen=True)
class Stretch:
    """A fitted stretch: its window, its joints, their degree, and the motion piece by piece.

    ``parameters``: how many numbers the record had to give for it. The pieces are polynomials of
    degree 2 at least.
    """

    window: Window
    joints: Joints
    degree: int
    pieces: PPoly
    parameters: int

    def at(self, time: Array) -> Array:
        """Return the displacement (n,) at times (n,) inside the pieces."""
        return np.asarray(self.pieces(time))


def at_ends(path: PPoly) -> Array:
    """Return the values (k,) at the ends of k pieces, each from within."""
    value, length = np.zeros(path.c.shape[1]), np.diff(path.x)
    for row in path.c:
        value = value * length + row
    return value


@dataclass(frozen=True)
class FittedSpline:
    """A fitted spline: joints, degree, coefficients of its B-splines, residuals of the samples."""

    joints: Joints
    degree: int
    coefficients: Array
    residuals: Array

    @property
    def parameters(self) -> int:
        """Number of free coefficients."""
        return self.coefficients.size - sum(_fixed(self.joints))

    def pieces(self) -> PPoly:
        """Return the polynomial between each two knots."""
        full = _full_knots(self.joints, self.degree)
        poly = PPoly.from_spline(BSpline(full, self.coefficients, self.degree))
        return PPoly(poly.c[:, np.diff(poly.x) > 0.0], self.joints.knots)


def fit(joints: Joints, time: Array, displacement: Array, degree: int) -> FittedSpline:
    """Return the spline on these joints that minimises the squared residuals of n samples."""
    origin = float(displacement[0])
    y, knots = displacement - origin, joints.knots
    shares = np.linspace(0.0, 1.0, degree + 1)
    between = (knots[:-1, None] + np.diff(knots)[:, None] * shares).ravel()
    full = _full_knots(joints, degree)
    basis = _basis(full, np.concatenate([time, between]), degree)
    goal = np.concatenate([y, np.interp(between, time, y)])
    weight = np.where(np.arange(goal.size) < y.size, 1.0, _PULL)
    size = full.size - degree - 1
    low, high = _fixed(joints)
    c = np.zeros(size)
    c[:low] = 0.0 if joints.left is None else joints.left - origin
    c[size - high :] = 0.0 if joints.right is None else joints.right - origin
    if size - high > low:
        left = weight * (goal - _product(basis, c))
        band = _banded_gram(basis, weight, size)[:, low : size - high]
        right_side = _moments(basis, left, size)[low : size - high]
        c[low : size - high] = solveh_banded(band, right_side, check_finite=False)
    return FittedSpline(joints, degree, c + origin, (goal - _product(basis, c))[: y.size])


def _full_knots(joints: Joints, degree: int) -> Array:
    """Return the knots with their multiplicity: degree + 1 at the ends, degree at kinks."""
    repeats = np.where(joints.kinked, degree, 1)
    repeats[0] = repeats[-1] = degree + 1
    return np.repeat(joints.knots, repeats)


def _fixed(joints: Joints) -> tuple[int, int]:
    """Return how many coefficients the dwells determine at either end."""
    low = 0 if joints.left is None else (1 if joints.kinked[0] else 2)
    high = 0 if joints.right is None else (1 if joints.kinked[-1] else 2)
    return low, high


def _basis(full: Array, time: Array, degree: int) -> Basis:
    """Return the first coefficient (n,) that each time depends on, and its B-splines (n, p + 1)."""
    rows = BSpline.design_matrix(np.clip(time, full[0], full[-1]), full, degree)
    shape = time.size, degree + 1
    return rows.indices.reshape(shape)[:, 0], rows.data.reshape(shape)


def _product(basis: Basis, coefficients: Array) -> Array:
    """Return the values (n,) of the spline."""
    first, splines = basis
    values = np.zeros(first.size)
    for p in range(splines.shape[1]):
        values += splines[:, p] * coefficients[first + p]
    return values


def _moments(basis: Basis, values: Array, size: int) -> Array:
    """Return the product (size,) of the transposed basis with values (n,)."""
    first, splines = basis
    moments = np.zeros(size)
    for p in range(splines.shape[1]):
        moments += np.bincount(first + p, weights=splines[:, p] * values, minlength=size)
    return moments


def _banded_gram(basis: Basis, weight: Array, size: int) -> Array:
    """Return the upper banded form (p + 1, size) of basis^T weight basis."""
    first, splines = basis
    degree = splines.shape[1] - 1
    band = np.zeros((degree + 1, size))
    for q in range(degree + 1):
        weighted = weight * splines[:, q]
        for p in range(q + 1):
            terms = weighted * splines[:, p]
            band[degree - q + p] += np.bincount(first + q, weights=terms, minlength=size)
    band[degree] += _ROUNDOFF * max(float(band[degree].max()), 1e-300)
    return band


def smooth_curve(
    ends: Joints, window: Window, tol: Tolerance, *, nearly: bool = False
) -> Stretch | None:
    """Return a quintic spline between dwells, or None if none agrees with the readings.

    ``nearly``: whether a few spans may not, as where a long vibration begins and ends at once.
    """
    spline, faithful = _refined(ends, window, tol)
    if ends.left is not None or ends.right is not None:
        for side in (0, -1):
            spline = _with_better_end(spline, side, window)
        ends = Joints(
            spline.joints.knots[[0, -1]], spline.joints.kinked[[0, -1]], ends.left, ends.right
        )
        spline, faithful = _refined(ends, window, tol)
    curve = Stretch(window, spline.joints, _SMOOTH, spline.pieces(), spline.parameters)
    if nearly and not faithful:
        faithful = bool(np.mean(_unfaithful(spline, window, tol)) <= _MOST_FAILING)
    return curve if faithful else None


def _smoothest(joints: Joints, window: Window) -> FittedSpline:
    return fit(joints, window.time, window.displacement, _SMOOTH)


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
        return float(np.sum(_smoothest(_local(joints, side, end), part).residuals ** 2))

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


def _refined(joints: Joints, window: Window, tol: Tolerance) -> tuple[FittedSpline, bool]:
    """Halve spans until all agree with the readings; return the fit and whether all do."""
    spline = _smoothest(joints, window)
    for _ in range(_ROUNDS):
        failing = _unfaithful(spline, window, tol)
        if not failing.any():
            return spline, True
        halved = _halved(spline.joints, window.time, failing)
        if halved is None:
            break
        spline = _smoothest(halved, window)
    return spline, False


def _unfaithful(spline: FittedSpline, window: Window, tol: Tolerance) -> NDArray[np.bool_]:
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
