r"""How far Laplace's evidence can be trusted, and the evidence without it.

Importance sampling about the optimum, q a Student-t with the curvature's covariance (Geweke 1989,
doi:10.2307/1913710):

.. math:: Z = E_q[w], \quad w = L(\theta) \pi(\theta) / q(\theta)

The effective number of draws is (sum w)^2 / sum w^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from qlvbayes.diagnosis.contest import Round
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.nested import LIVE, nested_evidence
from qlvbayes.inference.subset import Ensemble, Part, Place
from qlvbayes.posterior import Posterior, is_prior
from qlvbayes.priors import Dirichlet, HalfNormal

_TAIL = 5.0  # degrees of freedom of the draws
_TOGETHER = 25  # draws computed at once


@dataclass(frozen=True)
class LaplaceCheck:
    """Log evidence by importance sampling, with its standard error, and what speaks against Laplace.

    effective_draws: what the draws are worth; reasons: in words, none if all is well.
    """

    log_evidence: float
    error: float
    effective_draws: float
    reasons: tuple[str, ...]


def laplace_check(
    ensemble: Ensemble, point: Point, *, draws: int = 200, seed: int = 0
) -> LaplaceCheck:
    """Sample about an optimum and look at its covariance."""
    free = point.subset.theta
    around = multivariate_t(point.theta[free], point.covariance, df=_TAIL, seed=seed)
    places = around.rvs(draws).reshape(draws, free.size)
    thetas = np.tile(point.theta, (draws, 1))
    thetas[:, free] = places
    logs = log_densities(ensemble, point, thetas) - around.logpdf(places)
    total = float(logsumexp(logs))
    effective = float(np.exp(2.0 * total - logsumexp(2.0 * logs)))
    return LaplaceCheck(
        total - math.log(draws), math.sqrt(1 / effective - 1 / draws), effective, ()
    )


def log_densities(ensemble: Ensemble, point: Point, thetas: np.ndarray) -> np.ndarray:
    """(N,) log densities of the point's subset at thetas (N, D), on the smallest part."""
    whole = ensemble.posterior
    priors, constants = _priors(whole, jnp.asarray(thetas))
    nulled = point.subset.nulled(np.asarray(constants))
    effects = point.subset.effects
    part = next(part for part in ensemble.parts if effects <= part.effects)
    likelihoods = _likelihoods(part.posterior, jnp.asarray(nulled[:, part.constants]))
    found = np.asarray(likelihoods) + np.asarray(priors)[:, point.subset.priors].sum(axis=1)
    return np.where(np.isfinite(found), found, -np.inf)


@jax.jit
def _priors(posterior: Posterior, thetas: Array) -> tuple[Array, Array]:
    """(N, L) log densities of the priors and (N, P) constants."""
    return jax.vmap(lambda x: (posterior.log_priors(x), posterior.constants(x)))(thetas)


@jax.jit
def _likelihoods(posterior: Posterior, constants: Array) -> Array:
    """(N,) log likelihoods of constants (N, P)."""

    def one(x: Array) -> Array:
        return jnp.sum(posterior._log_likelihoods(*posterior.with_constants(x)))

    return jax.lax.map(one, constants, batch_size=_TOGETHER)
