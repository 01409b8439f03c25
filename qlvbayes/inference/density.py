r"""The posterior density of one hypothesis, with its derivatives, in the prior's own numbers.

Whitened by the noise floor, residual r and Jacobian J of the force give loss, gradient and
curvature of minus the log density, the discrepancy of size s integrated out:

.. math:: \ell = \tfrac12 r^T Q r + \tfrac12 \ln|Q^{-1}| - \ln \pi, \quad
          g = -J Q r - \nabla \ln \pi, \quad H = J Q J^T - \nabla^2 \ln \pi,

with Q of `discrepancy`. H leaves out second derivatives of the force
(Gauss-Newton).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from numpy.typing import NDArray

from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.separation import Separated, Separation, Sized
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.noticeable import log_noticeable
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.priors.natural import Natural

Array = NDArray[np.float64]

_COARSE = 0.005  # of the peak force: noise under which modes are looked for first
_FARTHEST = 1e6  # times the largest force: beyond, squares overflow and nothing is fitted
_STEP = 1e-5  # of a natural length, over which a slope is taken: half a float64's digits


class Terms(NamedTuple):
    """Loss, gradient (F,) and curvature (F, F) over the free numbers; or of S sizes at once."""

    loss: Any
    gradient: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class Point:
    """A place in the density of a hypothesis, and what was computed there.

    theta (F,): the free numbers; constants (P,) and their slopes (P, F) along them;
    predicted (T, B) and responses (F, T, B): the force (N) and its slopes; residual (n,) and
    jacobian (F, n): whitened; prior: log density over the free numbers, gradient and curvature (of
    minus it); separation: of the discrepancy from what the slopes can follow.
    """

    own: Parameters
    theta: Array
    constants: Array
    slopes: Array
    predicted: Array
    responses: Array
    residual: Array
    jacobian: Array
    prior: Terms
    separation: Separation

    @cached_property
    def vectors(self) -> Array:
        """(1 + F, n): residual and Jacobian."""
        return np.concatenate([self.residual[None], self.jacobian])

    def terms(self, own: Sized | Separated) -> Terms:
        """Beside a discrepancy of one size."""
        products = own.products(self.vectors)
        return Terms(
            0.5 * (float(products[0, 0]) + own.log_volume) + self.prior.loss,
            self.prior.gradient - products[0, 1:],
            self.prior.curvature + products[1:, 1:],
        )

    def beyond(self, more: Array, own: Sized | Separated) -> tuple[Array, Array]:
        """Gradient (K,) and curvature (K, K) over K more columns of the Jacobian, without priors.

        more: (K, n), whitened. The free numbers follow: what they take off is taken off.
        """
        products = own.products(np.concatenate([self.vectors, more]))
        old, new = slice(1, len(self.vectors)), slice(len(self.vectors), None)
        beside = products[old, new]
        known = np.column_stack([beside, self.prior.gradient - products[0, old]])
        solved = np.linalg.solve(products[old, old] + self.prior.curvature, known)
        gradient = -products[0, new] - beside.T @ solved[:, -1]
        return gradient, products[new, new] - beside.T @ solved[:, :-1]


class Density:
    """Densities of all hypotheses of a space, under one floor."""

    def __init__(self, space: Space, whitener: Whitener, discrepancy: Discrepancy) -> None:
        self.space = space
        self.whitener = whitener
        self.discrepancy = discrepancy
        self._force = np.asarray(space.record.blocks.force)

    @cached_property
    def coarse(self) -> Density:
        """The same as if the noise were white and of half a per cent of the peak force."""
        size = _COARSE * float(np.max(np.abs(self._force)))
        whitener = self.whitener.replaced(size)
        none = Discrepancy.none(whitener, self.discrepancy.peak)
        return Density(self.space, whitener, none)

    def with_space(self, space: Space, features: Sequence[Array] = ()) -> Density:
        """Of other priors, about the same record; features (T, B): more of the discrepancy's."""
        return Density(space, self.whitener, self.discrepancy.beside(features))

    def without(self, left_out: NDArray[np.bool_]) -> Density:
        """The same with some of the n block means left out."""
        whitener = self.whitener.without(left_out)
        return Density(self.space, whitener, self.discrepancy.under(whitener))

    @property
    def log_constant(self) -> float:
        """What a log likelihood has that losses leave out: -n/2 ln(2 pi) - ln|Sigma|/2."""
        precisions = self.whitener.precisions
        return 0.5 * float(np.log(precisions).sum() - precisions.size * math.log(2.0 * math.pi))

    def predicted(self, hypothesis: Hypothesis, theta: Array) -> tuple[Array, Array]:
        """Block means (T, B) at theta (F,), and their slopes (F, T, B)."""
        return self._run(self.space.parameters(hypothesis), theta)[1:]

    def _run(self, own: Parameters, theta: Array) -> tuple[Array, Array, Array]:
        """Constants (1 + F, P) at theta and a step along each number, block means and slopes."""
        steps = _STEP * own.length
        constants = own.constants(_stepped(theta, steps))
        found = self.space.forces(own.hypothesis, constants)
        return constants, found[0], (found[1:] - found[0]) / steps[:, None, None]

    def at(self, hypothesis: Hypothesis, theta: Array) -> Point | None:
        """Everything at theta (F,); None where the force is not finite, or absurdly large."""
        own = self.space.parameters(hypothesis)
        constants, predicted, responses = self._run(own, theta)
        prior = _prior(own, theta)
        steps = np.abs(responses).max() * _STEP * own.length.max()
        largest = np.maximum(np.abs(predicted).max(), steps)  # not a number stays none
        if not (largest < _FARTHEST * self.discrepancy.peak and np.isfinite(prior.loss)):
            return None
        if not (np.isfinite(prior.gradient).all() and np.isfinite(prior.curvature).all()):
            return None
        white = self.whitener(np.concatenate([(self._force - predicted)[None], responses]))
        return Point(
            own,
            theta,
            constants[0],
            ((constants[1:] - constants[0]) / (_STEP * own.length)[:, None]).T,
            predicted,
            responses,
            white[0],
            white[1:],
            prior,
            self.discrepancy.separated(responses, own.length),
        )

    def log_density(
        self, own: Parameters, thetas: Array, tolerance: float, about: Sequence[Point]
    ) -> Array:
        """(K, S) log posterior density at thetas (K, F) and each size of the discrepancy.

        Less the likelihood's constant. Minus infinity beyond the bounds and where the force is not
        finite; amplitudes have the priors that leave out what is below the tolerance. The
        discrepancy is separated as at the nearest of some points, the modes.
        """
        inside = np.all((thetas >= own.lowest) & (thetas <= own.highest), axis=1)
        found = np.full((len(thetas), self.discrepancy.sizes.size), -np.inf)
        if not inside.any():
            return found
        predicted = self.space.forces(own.hypothesis, own.constants(thetas[inside]))
        residuals = self._force - predicted
        largest = np.abs(residuals).max(axis=(1, 2))
        sound = largest < _FARTHEST * self.discrepancy.peak  # not a number is not
        kept = np.flatnonzero(inside)[sound]
        white, nearest = self.whitener(residuals[sound]), _nearest(thetas[kept], about)
        for k, point in enumerate(about):
            some = nearest == k
            log = self.discrepancy.log_likelihoods(white[some], point.separation)
            prior = [_log_prior_of(own, theta, tolerance) for theta in thetas[kept[some]]]
            found[kept[some]] = log + np.array(prior)[:, None] if prior else log
        return found

    def terms(self, point: Point, size: float) -> Terms:
        """At a size (N) of the discrepancy."""
        return point.terms(self.discrepancy.at(size, point.separation))

    def loss(self, point: Point, size: float, separation: Separation) -> float:
        """Minus log density at a place, the discrepancy separated as at another one."""
        own = self.discrepancy.at(size, separation)
        misfit = float(own.squares(point.residual[None])[0])
        return 0.5 * (misfit + own.log_volume) + float(point.prior.loss)

    def terms_by_size(self, point: Point) -> Terms:
        """At each of the discrepancy's S sizes."""
        found = [self.terms(point, size) for size in self.discrepancy.sizes.tolist()]
        return Terms(*(np.array(values) for values in zip(*found, strict=True)))

    def likeliest_size(self, point: Point, near: float = 0.0) -> float:
        """Size (N) of highest density at a place, looked for from another one (N)."""
        return self.discrepancy.likeliest(point.residual, near, point.separation)


def _stepped(theta: Array, steps: Array) -> Array:
    """(1 + F, F): theta, and theta with a step along each number."""
    return np.concatenate([theta[None], theta + np.diag(steps)])


def _nearest(thetas: Array, about: Sequence[Point]) -> NDArray[np.intp]:
    """(K,) which of some points each of thetas (K, F) is nearest to, in natural lengths."""
    apart = [((thetas - one.theta) / one.own.length) ** 2 for one in about]
    return np.argmin([one.sum(axis=1) for one in apart], axis=0)


def _prior(own: Parameters, theta: Array) -> Terms:
    """Minus the log prior density, its gradient (F,) and curvature (F, F)."""
    direct = own.direct
    apart = theta[direct.theta] - direct.mean
    gradient, curvature = np.zeros(own.size), np.zeros((own.size, own.size))
    gradient[direct.theta] = direct.precision * apart
    curvature[direct.theta, direct.theta] = direct.curvature
    loss = 0.5 * float(gradient[direct.theta] @ apart) - direct.top
    for leaf in own.joint:
        here = slice(leaf.theta.start, leaf.theta.stop)
        log, first, second = map(np.asarray, _log_prior(*leaf.flat, theta[here]))
        loss -= float(log)
        gradient[here] = -first
        curvature[here, here] = _positive_part(-second)
    return Terms(loss, gradient, curvature)


def _log_prior_of(own: Parameters, theta: Array, tolerance: float) -> float:
    """Log prior density at theta (F,), of amplitudes that matter."""
    log = -float(_prior(own, theta).loss)
    for leaf in own.leaves:
        if isinstance(leaf.prior, Natural):
            log += log_noticeable(leaf.prior.inner, float(theta[leaf.theta.start]), 0.0, tolerance)
    return log


def _positive_part(matrix: Array) -> Array:
    """Symmetric part with negative eigenvalues taken as 0; 0 where the density has overflowed."""
    if not np.isfinite(matrix).all():
        return np.zeros_like(matrix)
    if matrix.size == 1:
        return np.maximum(matrix, 0.0)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


@partial(jax.jit, static_argnums=0)
def _log_prior(structure: Any, prior: tuple[Array, ...], numbers: JaxArray) -> tuple[JaxArray, ...]:
    """Log density and its two derivatives at numbers (size,), by a flattened prior."""
    whole: AbstractPrior = jax.tree.unflatten(structure, prior)

    def log(x: JaxArray) -> JaxArray:
        return jnp.sum(whole.constrain(x)[1])

    slope = jax.jacfwd(log)
    return log(numbers), slope(numbers), jax.jacfwd(slope)(numbers)
