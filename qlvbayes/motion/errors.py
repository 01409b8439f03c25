r"""Errors of a fitted motion that follow from the errors of its readings.

For readings of variance s_i^2 and a least-squares spline with basis B the errors of displacement
and of its derivatives have the variance

.. math:: \mathrm{var}\, \delta^{(k)}(t) = s^2 B^{(k)}(t) (B^T B)^{-1} B^{(k)}(t)^T

A knot that was fitted to the record lets the derivative of the next lower order jump
there, to first order in its shift, so its multiplicity is raised by one. Readings of an encoder
that repeat themselves share one rounding error: their variance is multiplied by their number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, dia_array

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance
from qlvbayes.motion.splines import Joints, Stretch
from qlvbayes.motion.stretch import FEWEST_OF_A_MOVE

_MOST_TIMES = 3000  # of a stretch at which errors are computed
_CHUNK, _MARGIN = 60, 20  # coefficients inverted at once, and those on either side of them
_ROUNDOFF = 1e-11


@dataclass(frozen=True)
class Errors:
    """Sds (n,) of displacement, velocity and acceleration at some times (n,)."""

    time: Array
    displacement: Array
    velocity: Array
    acceleration: Array


def errors(stretch: Stretch, tol: Tolerance) -> Errors:
    """Return the sds at the samples of a stretch (at 3000 of them at most)."""
    joints = stretch.joints
    time = stretch.window.time
    inside = np.flatnonzero((time >= joints.knots[0]) & (time <= joints.knots[-1]))
    if inside.size < 2:
        nothing = np.zeros(joints.knots.size)
        most = np.full(joints.knots.size, np.sqrt(tol.variance))
        return Errors(joints.knots, most, nothing + np.inf, nothing + np.inf)
    full, kept = repeated_knots(joints, stretch.degree)
    variance = _variance(stretch, inside, tol)
    pick = np.unique(np.linspace(0, inside.size - 1, min(inside.size, _MOST_TIMES)).astype(int))
    rows = [
        derivative(time[inside][pick], full, stretch.degree, order)[:, kept] for order in range(3)
    ]
    basis = csr_array(BSpline.design_matrix(time[inside], full, stretch.degree))[:, kept]
    shares = np.sqrt(_quadratic_forms(basis, rows))
    sd = np.sqrt(variance[pick]) * shares
    if tol.step == 0.0 and tol.noise == 0.0:  # what is left is no scatter: it does not average out
        sd[0] = np.sqrt(variance[pick])
    elif tol.noise == 0.0:
        sd[0] = np.minimum(sd[0], np.sqrt(tol.variance))
    if inside.size < FEWEST_OF_A_MOVE:  # many paths go through them
        sd[2] = np.inf
    return Errors(time[inside][pick], *sd)


def _variance(stretch: Stretch, inside: NDArray[np.intp], tol: Tolerance) -> Array:
    """Return the variance (n,) of each reading, of residuals or of the encoder."""
    x, t = stretch.window.displacement[inside], stretch.window.time[inside]
    if tol.step == 0.0 and tol.noise == 0.0:
        left = x - stretch.at(t)
        return np.full(x.size, max(float(np.mean(left**2)), 1e-30 * float(np.ptp(x)) ** 2))
    if tol.noise > 0.0:
        return np.full(x.size, tol.variance)
    change = np.flatnonzero(np.diff(x) != 0.0) + 1
    runs = np.diff(np.concatenate([[0], change, [x.size]]))
    return tol.variance * np.repeat(runs, runs)


def repeated_knots(joints: Joints, degree: int) -> tuple[Array, slice]:
    """Return the knots with multiplicity, and the coefficients that are free at the ends."""
    smooth = 2 if degree == 2 else 1  # a quintic's knots are not looked for
    repeats = np.where(joints.kinked, 3, smooth)
    repeats[0] = repeats[-1] = degree + 1
    full = np.repeat(joints.knots, repeats)
    low = 0 if joints.left is None or joints.kinked[0] else 1
    high = 0 if joints.right is None or joints.kinked[-1] else 1
    return full, slice(low, full.size - degree - 1 - high)


def derivative(t: Array, full: Array, degree: int, order: int) -> csr_array:
    """Return the matrix (n, coefficients) of derivatives of the B-splines."""
    size = full.size - degree - 1
    shift = None
    for step in range(order):
        k = degree - step
        inner = full[step : full.size - step] if step else full
        gap = inner[k + 1 : -1] - inner[1 : -k - 1]
        weight = np.where(gap > 0.0, k / np.where(gap > 0.0, gap, 1.0), 0.0)
        count = inner.size - k - 1
        difference = dia_array(
            (np.stack([np.append(-weight, 0.0), np.append(0.0, weight)]), [0, 1]),
            shape=(count - 1, count),
        ).tocsr()
        shift = difference if shift is None else difference @ shift
    inner = full[order : full.size - order] if order else full
    basis = csr_array(BSpline.design_matrix(t, inner, degree - order))
    return basis if shift is None else csr_array(basis @ shift[:, :size])


def _quadratic_forms(basis: csr_array, rows: list[csr_array]) -> Array:
    """Return the diagonals (len(rows), n) of rows (basis^T basis)^-1 rows^T, in chunks."""
    gram = csr_array(basis.T @ basis)
    size = gram.shape[0]
    ridge = _ROUNDOFF * float(gram.diagonal().max())
    forms = np.zeros((len(rows), rows[0].shape[0]))
    owner = _middle(rows[0])
    for start in range(0, size, _CHUNK):
        mine = np.flatnonzero((owner >= start) & (owner < start + _CHUNK))
        if mine.size == 0:
            continue
        part = slice(max(start - _MARGIN, 0), min(start + _CHUNK + _MARGIN, size))
        inverse = np.linalg.inv(gram[part, part].toarray() + ridge * np.eye(part.stop - part.start))
        for k, row in enumerate(rows):
            some = row[mine][:, part].toarray()
            forms[k, mine] = np.einsum("ij,jk,ik->i", some, inverse, some)
    return np.maximum(forms, 0.0)


def _middle(basis: csr_array) -> NDArray[np.intp]:
    """Return a column near the middle of each row's entries."""
    start, stop = basis.indptr[:-1], basis.indptr[1:]
    return np.asarray(basis.indices[np.minimum((start + stop) // 2, basis.indices.size - 1)])
