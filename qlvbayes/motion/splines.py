"""Least-squares splines that join dwells, on SciPy's B-splines.

Between knots the displacement is a polynomial of degree p. At a knot p - 1 derivatives are
continuous, at a kinked one the displacement alone. An end may be joined to a dwell: there the level
is given and the velocity is 0 unless that end is kinked. B-splines and their least squares: de
Boor, A Practical Guide to Splines, 2001, chapters IX and XIV.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly
from scipy.linalg import solveh_banded

from qlvbayes.io.arrays import Array

Flags = NDArray[np.bool_]
Basis = tuple[NDArray[np.intp], Array]

_PULL = 1e-8  # weight, over a reading's, of lines between readings, for pieces without readings
_ROUNDOFF = 1e-14  # of the normal matrix, so that it can be inverted


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
class Pieces:
    """Displacement, velocity and acceleration (k,) at the start of each of k polynomial pieces.

    ``higher`` (m, k): the coefficients of (t - start)^3, (t - start)^4, ...; none if the
    acceleration is constant.
    """

    knots: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    higher: Array | None = None


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

    def at(self, time: Array) -> Array:
        """Return the displacement (n,) at times (n,) inside the pieces."""
        part = self.pieces
        k = np.clip(np.searchsorted(part.knots, time, side="right") - 1, 0, part.knots.size - 2)
        s = time - part.knots[k]
        value = np.zeros_like(time)
        if part.higher is not None:
            for row in part.higher[::-1]:
                value = s * (value + row[k])
        value = part.velocity[k] + s * (0.5 * part.acceleration[k] + value)
        return part.displacement[k] + s * value


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

    def displacement(self, time: Array) -> Array:
        """Return the displacement at times (n,), constant beyond the ends."""
        return _product(
            _basis(_full_knots(self.joints, self.degree), time, self.degree), self.coefficients
        )

    def pieces(self) -> Pieces:
        """Return the polynomial between each two knots."""
        full = _full_knots(self.joints, self.degree)
        poly = PPoly.from_spline(BSpline(full, self.coefficients, self.degree))
        real = np.diff(poly.x) > 0.0
        rising = poly.c[::-1, real]
        higher = rising[3:] if self.degree > 2 else None
        return Pieces(self.joints.knots, rising[0], rising[1], 2.0 * rising[2], higher)


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
