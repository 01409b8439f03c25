r"""The posterior density of one hypothesis, with its derivatives, in the prior's own numbers.

Whitened by the noise floor, residual r and Jacobian J of the force give loss, gradient and
curvature of minus the log density, the discrepancy of size s integrated out:

.. math:: \ell = \tfrac12 r^T Q r + \tfrac12 \ln|Q^{-1}| - \ln \pi, \quad
          g = -J Q r - \nabla \ln \pi, \quad H = J Q J^T - \nabla^2 \ln \pi,

with Q = 1 - sum_m k_m u_m u_m^T of `discrepancy`. H leaves out second derivatives of the force
(Gauss-Newton).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from numpy.typing import NDArray

from qlvbayes.inference.discrepancy import Discrepancy
from qlvbayes.inference.forces import forces
from qlvbayes.inference.subset import Ensemble, Place, Subset
from qlvbayes.inference.whitening import Whitener
from qlvbayes.posterior import is_prior
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.priors.natural import Natural

Array = NDArray[np.float64]

_STEP = 1e-5  # of a free number, over which a slope is taken: half the digits of a float64


class Terms(NamedTuple):
    """Loss, gradient (F,) and curvature (F, F) over the free numbers."""

    loss: float
    gradient: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class Point:
    """A place in the density of a subset, and what was computed there.

    theta (D,): of the whole; constants (P,) and their slopes (P, F) along the free numbers;
    predicted (T, B) and responses (F, T, B): the force (N) and its slopes; residual (n,) and
    jacobian (F, n): whitened; parts (M,) and (F, M): of both along the discrepancy's axes; prior:
    log density over the free numbers, gradient and curvature (of minus it).
    """

    subset: Subset
    theta: Array
    constants: Array
    slopes: Array
    predicted: Array
    responses: Array
    residual: Array
    jacobian: Array
    parts: Array
    jacobian_parts: Array
    prior: Terms

    @cached_property
    def squares(self) -> float:
        """Of the whitened residual, summed: n where only noise is left."""
        return float(self.residual @ self.residual)

    @cached_property
    def _products(self) -> tuple[Array, Array]:
        return self.jacobian @ self.residual, self.jacobian @ self.jacobian.T

    def terms(self, taken: Array, log_volume: float) -> Terms:
        """With shares (M,) of each axis taken by a discrepancy; log_volume: ln|Q^-1|."""
        slope, information = self._products
        own = self.jacobian_parts
        loss = 0.5 * (self.squares - float(taken @ self.parts**2) + log_volume)
        gradient = -(slope - own @ (taken * self.parts))
        curvature = information - (own * taken) @ own.T
        return Terms(
            loss + self.prior.loss,
            gradient + self.prior.gradient,
            curvature + self.prior.curvature,
        )


class Density:
    """Densities of all subsets of an ensemble, whose amplitudes are `Natural`, under one floor."""

    def __init__(self, ensemble: Ensemble, whitener: Whitener, discrepancy: Discrepancy) -> None:
        self.ensemble = ensemble
        self.whitener = whitener
        self.discrepancy = discrepancy
        self.rows = np.ones(whitener.tests.size, dtype=bool)
        self._force = np.asarray(ensemble.posterior.record.blocks.force)
        whole = ensemble.posterior
        leaves = jax.tree.leaves((whole.model, whole.noise), is_leaf=is_prior)
        self._leaves: list[tuple[Place, AbstractPrior]] = [
            (place, leaf)
            for place, leaf in zip(ensemble.places, leaves, strict=True)
            if is_prior(leaf)
        ]
        fixed = [np.ravel(leaf) if not is_prior(leaf) else None for leaf in leaves]
        self._fixed = np.zeros(len(ensemble.names))
        for place, value in zip(ensemble.places, fixed, strict=True):
            if value is not None:
                self._fixed[list(place.constants)] = value

    def without(self, test: int) -> Density:
        """The same with one test left out."""
        rows = self.whitener.tests != test
        found = Density(self.ensemble, self.whitener, self.discrepancy.of_some(rows))
        found.rows = rows
        return found

    def with_shapes(self, shapes: Array, peak: float, tolerance: float) -> Density:
        """The same with a discrepancy of shapes (M, T, B) in N."""
        found = Discrepancy.of(self.whitener(shapes), peak, tolerance)
        return Density(self.ensemble, self.whitener, found)

    def bounds(self, subset: Subset) -> tuple[Array, Array]:
        """Least values (F,) of the free numbers, and the lengths (F,) of their natural step."""
        lowest, length = np.full(subset.theta.size, -np.inf), np.ones(subset.theta.size)
        where = {int(k): j for j, k in enumerate(subset.theta)}
        for place, leaf in self._leaves:
            if isinstance(leaf, Natural) and place.theta[0] in where:
                j = where[place.theta[0]]
                lowest[j], length[j] = leaf.lowest, leaf.sd
        return lowest, length

    def at(self, subset: Subset, theta: Array) -> Point | None:
        """Everything at theta (D,); None where the force is not finite."""
        constants, slopes, prior = self._prior(subset, theta)
        _, length = self.bounds(subset)
        steps = _STEP * length
        rows = np.concatenate([constants[None], constants + (slopes * steps).T])
        found = forces(self.ensemble, rows)
        if not (np.isfinite(found).all() and np.isfinite(prior.loss)):
            return None
        predicted = found[0]
        responses = (found[1:] - predicted) / steps[:, None, None]
        white = self.whitener(np.concatenate([(self._force - predicted)[None], responses]))
        white = white[:, self.rows]
        parts = white @ self.discrepancy.axes.T
        return Point(
            subset,
            theta,
            constants,
            slopes,
            predicted,
            responses,
            white[0],
            white[1:],
            parts[0],
            parts[1:],
            prior,
        )

    def terms(self, point: Point, size: float) -> Terms:
        """At a size (N) of the discrepancy."""
        own = self.discrepancy
        volume = float(np.log1p(size**2 * own.strengths).sum())
        return point.terms(own.taken(size), volume)

    def likeliest_size(self, point: Point) -> float:
        """Size (N) of highest density at a place."""
        losses = self.discrepancy.losses(point.parts**2) - self.discrepancy.log_prior
        return float(self.discrepancy.sizes[np.argmin(losses)])

    def _prior(self, subset: Subset, theta: Array) -> tuple[Array, Array, Terms]:
        """Constants (P,), slopes (P, F) and the prior's terms."""
        free = subset.theta
        where = {int(k): j for j, k in enumerate(free)}
        constants = self._fixed.copy()
        slopes = np.zeros((constants.size, free.size))
        loss, gradient = 0.0, np.zeros(free.size)
        curvature = np.zeros((free.size, free.size))
        for place, leaf in self._leaves:
            numbers = theta[place.theta.start : place.theta.stop]
            value, slope, log, first, second = map(np.asarray, _leaf(leaf, numbers))
            constants[list(place.constants)] = value
            if place.theta[0] not in where:
                continue
            own = [where[k] for k in place.theta]
            slopes[np.ix_(list(place.constants), own)] = slope
            loss -= float(log)
            gradient[own] = -first
            curvature[np.ix_(own, own)] = _positive_part(-second)
        slopes *= np.isnan(subset.null)[:, None]
        return subset.nulled(constants), slopes, Terms(loss, gradient, curvature)


@jax.jit
def _leaf(prior: AbstractPrior, numbers: JaxArray) -> tuple[JaxArray, ...]:
    """Value (k,), its slopes (k, size), log density and its two derivatives, at numbers (size,)."""

    def value(x: JaxArray) -> JaxArray:
        return jnp.ravel(prior.constrain(x)[0])

    def log(x: JaxArray) -> JaxArray:
        return jnp.sum(prior.constrain(x)[1])

    slope = jax.jacfwd(log)
    return (
        value(numbers),
        jax.jacfwd(value)(numbers),
        log(numbers),
        slope(numbers),
        jax.jacfwd(slope)(numbers),
    )


def _positive_part(matrix: Array) -> Array:
    """Symmetric part with negative eigenvalues taken as 0."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
