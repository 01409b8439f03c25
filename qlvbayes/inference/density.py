r"""Evaluate the posterior density of one hypothesis and its first two derivatives.

The free parameters are those of the prior (unconstrained numbers, or amplitudes within bounds).
With residual r and Jacobian J of the force, whitened by the noise floor, and with a discrepancy of
size s integrated out, minus the log density has the value, gradient and curvature

.. math:: \ell = \tfrac12 r^T Q r + \tfrac12 \ln|Q^{-1}| - \ln \pi, \quad
          g = -J Q r - \nabla \ln \pi, \quad H = J Q J^T - \nabla^2 \ln \pi,

where Q is the precision matrix that `discrepancy` defines. H leaves out the second derivatives of
the force (the Gauss-Newton approximation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.motionerrors import motion_columns
from qlvbayes.inference.errors.scatter import NONE, by_test, scaled_parts
from qlvbayes.inference.errors.separation import DiscrepancyOfSize, Separation
from qlvbayes.inference.forward.hypothesis import Hypothesis, Leaf, Parameters
from qlvbayes.inference.forward.space import STEP, Space
from qlvbayes.io.arrays import Array

_COARSE = 0.005  # of the peak force: sd of the noise under which modes are first searched for
LARGEST_FORCE = 1e6
"""Times the peak force: beyond it squares overflow and nothing fits."""
_KEPT = 4  # sizes of the discrepancy whose matrices, of megabytes, a part of the data keeps: a fit
# goes to and fro between two
_AT_BOUND = 1e-6  # of a natural length
_PRIOR_STEP = 3e-4  # of the unconstrained numbers of a prior


class Terms(NamedTuple):
    """The second-order expansion of minus the log density at a point."""

    # gradient (F,) and curvature (F, F) are over the F free parameters; each has a leading axis of
    # length S where several sizes of the discrepancy are evaluated together
    loss: Any
    gradient: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class Point:
    """A point theta in the parameter space of a hypothesis, with all that was computed there."""

    own: Parameters
    theta: Array  # (F,): free parameters
    constants: Array  # (P,): the model's constants
    slopes: Array  # (P, F): derivatives of the constants with respect to theta
    predicted: Array  # (T, B): block means of the force (N)
    responses: Array  # (F, T, B): derivatives of these with respect to theta
    vectors: Array  # (1 + F, n): residual and Jacobian, whitened
    prior: Terms  # expansion of minus the log prior density
    # separates the discrepancy from what the derivatives of the force can follow
    separation: Separation

    @property
    def residual(self) -> Array:
        """Return the whitened residual (n,)."""
        return self.vectors[0]

    @property
    def jacobian(self) -> Array:
        """Return the whitened Jacobian (F, n) of the force."""
        return self.vectors[1:]

    @property
    def scattered(self) -> Array:
        """Return the parts (K, T, B) of the force (N) that scatter between tests at this point."""
        sizes = self.separation.scatter.sizes
        parts = scaled_parts(self.predicted, self.responses, self.theta, self.own.amplitudes)
        return by_test(parts[np.flatnonzero(sizes)])

    def terms(self, discrepancy: DiscrepancyOfSize) -> Terms:
        """Return the expansion of minus the log density, given a discrepancy of one size."""
        products, prior = discrepancy.products(self.vectors), self.prior
        return Terms(
            0.5 * (float(products[0, 0]) + discrepancy.log_volume) + prior.loss,
            prior.gradient - products[0, 1:],
            prior.curvature + products[1:, 1:],
        )

    def added_terms(self, columns: Array, discrepancy: DiscrepancyOfSize) -> Terms:
        """Return the expansion over K added parameters that have no prior, at whitened columns.

        The others follow at their best: the loss is theirs, without those that are added.
        """
        products = discrepancy.products(np.concatenate([self.vectors, columns]))
        old, new = slice(1, len(self.vectors)), slice(len(self.vectors), None)
        mixed, toward = products[old, new], self.prior.gradient - products[0, old]
        known = np.column_stack([mixed, toward])
        solved = np.linalg.solve(products[old, old] + self.prior.curvature, known)
        misfit = float(products[0, 0] - toward @ solved[:, -1])
        gradient = -products[0, new] - mixed.T @ solved[:, -1]
        curvature = products[new, new] - mixed.T @ solved[:, :-1]
        return Terms(0.5 * (misfit + discrepancy.log_volume), gradient, curvature)


class Density:
    """The posterior densities of all hypotheses of a space, under the noise of a discrepancy."""

    def __init__(self, space: Space, discrepancy: Discrepancy) -> None:
        self.space = space
        self.discrepancy = discrepancy
        self.whitener = discrepancy.whitener
        self._force = np.asarray(space.record.blocks.force)

    @cached_property
    def coarse(self) -> Density:
        """Return the density under white noise of 0.5 % of the peak force, without discrepancy."""
        size = _COARSE * float(np.max(np.abs(self._force)))
        return self.with_independent_noise(size)

    def with_independent_noise(self, sds: Array | float, common: Array | None = None) -> Density:
        """Return the density under independent noise of sds (n,) or one sd (N), no discrepancy.

        ``common`` (S, T, B): changes of the force (N) by one standard error each that tests share.
        """
        whitener = self.whitener.with_independent_noise(sds)
        whitener = whitener if common is None else whitener.with_common(common)
        return Density(self.space, Discrepancy.none(whitener, self.discrepancy.peak))

    def with_space(self, space: Space, features: Sequence[Array] = ()) -> Density:
        """Return the density with another space, whose priors may differ, about the same record."""
        return Density(space, self.discrepancy.with_features(features))

    def without(self, left_out: NDArray[np.bool_]) -> Density:
        """Return the density with some of the n block means left out; left_out (n,) marks them."""
        whitener = self.whitener.without(left_out)
        return Density(self.space, self.discrepancy.with_whitener(whitener, _KEPT))

    def at(
        self, hypothesis: Hypothesis, theta: Array, like: Separation | None = None
    ) -> Point | None:
        """Return the point at theta (F,); None where the force is not finite or absurdly large."""
        parameters = self.space.parameters(hypothesis)
        constants, predicted, responses = self.space.forces_and_slopes(hypothesis, theta)
        prior = _prior(parameters, theta)
        steps = np.abs(responses).max() * STEP * parameters.length.max()
        largest = np.maximum(np.abs(predicted).max(), steps)  # a NaN fails the comparison below
        if not (
            largest < LARGEST_FORCE * self.discrepancy.peak
            and all(np.isfinite(one).all() for one in prior)
        ):
            return None
        # what lies at one of its bounds follows nothing beyond it
        near = _AT_BOUND * parameters.length
        movable = (theta > parameters.lowest + near) & (theta < parameters.highest - near)
        separation = self.discrepancy.separated(
            np.where(movable[:, None, None], responses, 0.0),
            parameters.length,
            partial(scaled_parts, predicted, responses, theta, parameters.amplitudes),
            NONE if like is None else like.scatter,
            self._motion_errors(hypothesis, constants[0]) if like is None else like.errors,
        )
        slopes = ((constants[1:] - constants[0]) / (STEP * parameters.length)[:, None]).T
        vectors = self.whitener(np.concatenate([(self._force - predicted)[None], responses]))
        own = constants[0], slopes, predicted, responses, vectors, prior, separation
        return Point(parameters, theta, *own)

    def _motion_errors(self, hypothesis: Hypothesis, constants: Array) -> Array | None:
        """Return errors (K, n) of the force by those of speed and acceleration (N)."""
        if not len(self.discrepancy.features):
            return None
        columns = motion_columns(self.space, self.whitener, hypothesis, constants)
        return self.whitener.flattened(columns) if len(columns) else None

    def log_density(
        self,
        parameters: Parameters,
        thetas: Array,
        tolerance: float,
        modes: Sequence[Point],
        sizes: Sequence[int] | None = None,
    ) -> Array:
        """Return log posterior densities (K, S) at thetas (K, F) and sizes of the discrepancy.

        They are minus infinity at sizes other than those of the indices ``sizes``, if given.
        """
        logs = np.full((len(thetas), self.discrepancy.sizes.size), -np.inf)
        largest = LARGEST_FORCE * self.discrepancy.peak
        kept, priors, residuals = self.space.residuals(parameters.hypothesis, thetas, largest)
        for amplitude in parameters.amplitude_of.values():
            values = thetas[kept, amplitude.number].tolist()
            priors = priors + [log_noticeable(amplitude.prior, x, 0.0, tolerance) for x in values]
        white = self.whitener(residuals)
        apart = [((thetas[kept] - one.theta) / one.own.length) ** 2 for one in modes]
        nearest = np.argmin([one.sum(axis=1) for one in apart], axis=0)
        for k, point in enumerate(modes):
            nearest_k = nearest == k
            likelihood = self.discrepancy.log_likelihoods(white[nearest_k], point.separation, sizes)
            logs[kept[nearest_k]] = likelihood + priors[nearest_k, None]
        return logs

    def terms(self, point: Point, size: float) -> Terms:
        """Return the expansion of minus the log density, given a discrepancy of a size (N)."""
        return point.terms(self.discrepancy.at(size, point.separation))

    def loss(self, point: Point, size: float, separation: Separation) -> float:
        """Return minus the log density at a point; the separation may be another point's."""
        discrepancy = self.discrepancy.at(size, separation)
        misfit = float(discrepancy.squares(point.residual[None])[0])
        return 0.5 * (misfit + discrepancy.log_volume) + float(point.prior.loss)

    def likeliest_size(self, point: Point, guess: float = 0.0) -> float:
        """Return the size (N) of highest density at a point; the search starts from a guess (N)."""
        return self.discrepancy.likeliest_size(point.residual, guess, point.separation)

    def likeliest(self, point: Point, guess: float = 0.0) -> tuple[float, Point]:
        """Return the size (N) of highest density, and the point with the likeliest scatter."""
        errors = self._motion_errors(point.own.hypothesis, point.constants)
        separation = point.separation.with_errors(errors)
        size, scatter = self.discrepancy.likeliest(point.residual, guess, separation)
        return size, replace(point, separation=separation.with_scatter(scatter))


def _prior(parameters: Parameters, theta: Array) -> Terms:
    """Return the expansion of minus the log prior density at theta (F,)."""
    direct = parameters.direct
    offset = theta[direct.theta] - direct.mean
    gradient, curvature = np.zeros(parameters.size), np.zeros((parameters.size, parameters.size))
    gradient[direct.theta] = direct.precision * offset
    curvature[direct.theta, direct.theta] = direct.curvature
    loss = 0.5 * float(gradient[direct.theta] @ offset) - direct.top
    for leaf in parameters.joint:
        here = slice(leaf.theta.start, leaf.theta.stop)
        with np.errstate(all="ignore"):
            log, first, second = _expanded(leaf, theta[here])
        loss -= log
        gradient[here] = -first
        overflowed = not np.isfinite(second).all()
        curvature[here, here] = 0.0 if overflowed else positive_part(-second)
    return Terms(loss, gradient, curvature)


def positive_part(matrix: Array) -> Array:
    """Return the symmetric part of a matrix (F, F) with its negative eigenvalues set to 0."""
    if matrix.size == 1:
        return np.maximum(matrix, 0.0)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _expanded(leaf: Leaf, theta: Array) -> tuple[float, Array, Array]:
    """Return log prior density, gradient and curvature over theta (size,) of one field.

    They are differences of the density, which is smooth, over steps that leave eight digits.
    """
    steps = _PRIOR_STEP * np.eye(theta.size)
    pairs = steps[:, None] + steps
    points = [theta[None], theta + steps, theta - steps, *(theta + pairs), *(theta - pairs)]
    logs = np.asarray(leaf.prior.constrain(np.concatenate(points).T)[1])
    count = theta.size
    middle, forth, back = logs[0], logs[1 : 1 + count], logs[1 + count : 1 + 2 * count]
    both_forth, both_back = logs[1 + 2 * count :].reshape(2, count, count)
    alone = forth + back
    curvature = both_forth + both_back - alone[:, None] - alone + 2.0 * middle
    # along one parameter the pair is one step of twice the length
    diagonal = (alone - 2.0 * middle) / _PRIOR_STEP**2
    curvature = curvature / (2.0 * _PRIOR_STEP**2)
    np.fill_diagonal(curvature, diagonal)
    return float(middle), (forth - back) / (2.0 * _PRIOR_STEP), curvature
