r"""Errors of a fitted motion, and of the times of its knots, from the errors of its readings.

For readings of variance s_i^2 and a least-squares spline with basis B the errors of displacement
and of its derivatives have the variance

.. math:: \mathrm{var}\, \delta^{(k)}(t) = s^2 B^{(k)}(t) (B^T B)^{-1} B^{(k)}(t)^T

A knot that was fitted to the record lets the derivative of the next lower order jump
there, to first order in its shift, so its multiplicity is raised by one. Readings of an encoder
that repeat themselves share one rounding error: their variance is multiplied by their number.

A knot that is late by d lets a velocity that jumps by J there jump by -J d in displacement, to
first order, and an acceleration that jumps by J by -J d in velocity:

.. math:: \mathrm{var}\, t_k = \mathrm{var}(\text{jump of the next lower order at } t_k) / J_k^2

Free are the jumps at all knots at once. The level of a dwell next to the stretch counts with its
own error, a step over sqrt(12) at least. Rounding errors of a motion that passes nearly a whole
number of steps from reading to reading are taken as one error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, dia_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from qlvbayes.io.arrays import Array
from qlvbayes.motion.bounds import Tolerance
from qlvbayes.motion.sensor import last_decimal
from qlvbayes.motion.splines import Joints, Stretch, at_ends
from qlvbayes.motion.stretch import FEWEST_OF_A_MOVE

_MOST_TIMES = 3000  # of a stretch at which errors are computed
_CHUNK = 300  # times at once, so that their solutions are no large array
_ROUNDOFF = 1e-11
_EXACT = 1e-6  # of the range: no reading is better than that
_RESOLVED = 3  # readings in a piece that show where it begins and ends
_UNIFORM = float(np.sqrt(12.0))  # a length over the sd of a moment anywhere in it
_MOST = 1000  # knots whose moments are computed; of more each takes its piece's bound


class Errors(NamedTuple):
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
        most, unknown = (np.full(joints.knots.size, x) for x in (np.sqrt(tol.variance), np.inf))
        return Errors(joints.knots, most, unknown, unknown)
    full, kept = repeated_knots(joints, stretch.degree)
    variance = _variance(stretch, inside, tol)
    pick = np.unique(np.linspace(0, inside.size - 1, min(inside.size, _MOST_TIMES)).astype(int))
    rows = [
        derivative(time[inside][pick], full, stretch.degree, order)[:, kept] for order in range(3)
    ]
    basis = csr_array(BSpline.design_matrix(time[inside], full, stretch.degree))[:, kept]
    inverse, shares = _inverse(basis), np.zeros((3, pick.size))
    for some in np.array_split(np.arange(pick.size), pick.size // _CHUNK + 1):
        for order, row in enumerate(rows):  # the diagonal of row (basis^T basis)^-1 row^T
            right = row[some].T.toarray()
            shares[order, some] = np.sum(right * inverse.solve(right), axis=0)
    sd = np.sqrt(variance[pick]) * np.sqrt(np.maximum(shares, 0.0))
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


def _inverse(basis: csr_array) -> SuperLU:
    """Return the factors of basis^T basis."""
    gram = csr_array(basis.T @ basis).tocsc()
    ridge = np.full(gram.shape[0], _ROUNDOFF * float(gram.diagonal().max()))
    return splu(gram + diags_array(ridge).tocsc())


def moments(stretch: Stretch, tol: Tolerance, level_sd: tuple[float, float], clock: float) -> Array:
    """Return the sds (k,) in s of a stretch's knots."""
    joints, time = stretch.joints, stretch.window.time
    knots = joints.knots
    lengths = np.diff(knots)
    shorter = np.minimum(np.append(lengths, np.inf), np.append(np.inf, lengths))
    near = np.clip(np.searchsorted(time, knots), 1, time.size - 1)
    interval = time[near] - time[near - 1]
    most = np.maximum(shorter, interval) / _UNIFORM
    inside = np.flatnonzero((time >= knots[0]) & (time <= knots[-1]))
    sd = most.copy()
    if inside.size > 2 and knots.size <= _MOST:
        sd = np.minimum(most, _from_readings(stretch, tol, inside, level_sd, clock))
    read = np.diff(np.searchsorted(time[inside], knots))
    fewest = np.minimum(np.append(read, np.inf), np.append(np.inf, read))
    sd = np.where(fewest < _RESOLVED, np.maximum(sd, interval / _UNIFORM), sd)
    sd[[0, -1]] *= [joints.left is not None, joints.right is not None]
    return sd


def _from_readings(
    stretch: Stretch,
    tol: Tolerance,
    inside: NDArray[np.intp],
    level_sd: tuple[float, float],
    clock: float,
) -> Array:
    """Return the sds (k,) by least squares; infinite where neither speed nor acceleration jumps."""
    joints, degree, time = stretch.joints, stretch.degree, stretch.window.time[inside]
    full, kept = repeated_knots(joints, degree)
    basis = csr_array(BSpline.design_matrix(time, full, degree))
    rows, size = _jumps(stretch, full)
    speed = np.gradient(stretch.at(time), time)
    variance = _variance_of_knots(stretch, inside, tol) + (np.abs(speed) * clock) ** 2
    free = basis[:, kept]
    weight = _inverse(free).solve(rows[:, kept].T.toarray())  # (coefficients, knots)
    variances = np.sum((diags_array(np.sqrt(variance)) @ (free @ weight)) ** 2, axis=0)
    for side, sd in zip((0, -1), level_sd, strict=True):
        at = 0 if side == 0 else full.size - degree - 2
        if kept.start <= at < kept.stop:  # the displacement itself is free to jump to the level
            variances[side] += sd**2
        else:
            column = basis[:, [at]].toarray()[:, 0]
            held = rows[:, [at]].toarray()[:, 0] - weight.T @ (free.T @ column)
            variances += (held * sd) ** 2
    unbounded = np.full(size.shape, np.inf)
    return np.asarray(np.divide(np.sqrt(variances), size, out=unbounded, where=size > 0.0))


def _variance_of_knots(stretch: Stretch, inside: NDArray[np.intp], tol: Tolerance) -> Array:
    """Return the variance (n,) of each reading, times the readings that share its error."""
    time, x = stretch.window.time[inside], stretch.window.displacement[inside]
    path = stretch.at(time)
    rounding = max(tol.step, last_decimal(x)) ** 2 / 12.0
    single = max(rounding + tol.noise**2, (_EXACT * float(np.ptp(x))) ** 2)
    if tol.step == 0.0 and tol.noise == 0.0:
        single = max(single, float(np.mean((x - path) ** 2)))
    if tol.noise > 0.5 * tol.step or tol.step == 0.0:
        return np.full(x.size, single)
    advance = np.diff(path) / tol.step
    beyond = np.abs(advance - np.round(advance))
    changing = np.abs(np.gradient(advance)) if advance.size > 1 else np.zeros(1)
    shared = 1.0 / np.maximum(np.maximum(beyond, np.sqrt(changing)), 1.0 / time.size)
    piece = np.searchsorted(stretch.joints.knots[1:-1], time, side="right")
    shared = np.minimum(np.append(shared, shared[-1]), np.bincount(piece)[piece])
    return np.asarray(single * np.maximum(shared, 1.0))


def _jumps(stretch: Stretch, full: Array) -> tuple[csr_array, Array]:
    """Return the row of the jump that a shift of each knot makes, and the next higher jump (k,)."""
    joints, degree, path = stretch.joints, stretch.degree, stretch.pieces
    knots = joints.knots
    after = np.append(knots[:-1], knots[-1])
    before = np.nextafter(knots, -np.inf)
    before[0] = knots[0]
    kinked = csr_array(joints.kinked[:, None].astype(float))
    smooth = csr_array((~joints.kinked)[:, None].astype(float))
    orders = []
    for order in (0, 1):
        right, left = (derivative(t, full, degree, order) for t in (after, before))
        keep_right, keep_left = np.ones(knots.size), np.ones(knots.size)
        keep_right[-1] = keep_left[0] = 0.0  # dwells lie outside
        orders.append(diags_array(keep_right) @ right - diags_array(keep_left) @ left)
    rows = csr_array(orders[0].multiply(kinked) + orders[1].multiply(smooth))
    speed, rate = (
        np.append(order.c[-1], 0.0) - np.append(0.0, at_ends(order))
        for order in (path.derivative(1), path.derivative(2))
    )
    return rows, np.abs(np.where(joints.kinked, speed, rate))
