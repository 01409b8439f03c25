r"""How far Laplace's evidence can be trusted, and the evidence without it.

Importance sampling about the optimum, q a Student-t with the curvature's covariance (Geweke 1989,
doi:10.2307/1913710):

.. math:: Z = E_q[w], \quad w = L(\theta) \pi(\theta) / q(\theta)

The effective number of draws is (sum w)^2 / sum w^2. Where they are worth less than a tenth of
their number, the lower of this evidence and Laplace's is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.linearised import compiled
from qlvbayes.inference.subset import Ensemble, Place
from qlvbayes.posterior import Posterior, is_prior
from qlvbayes.priors import AbstractPrior, Dirichlet, HalfNormal
from qlvbayes.wording import joined

DRAWS = 200
_TAIL = 5.0  # degrees of freedom of the draws
_WIDEST = 10.0  # sd of the draws along any direction of theta
_NARROWEST = 1e-9  # of the widest variance
_TOGETHER = 25  # draws computed at once
_FEW = 0.1  # of the draws, that are worth too little
_APART = 1.0  # error of Laplace's log evidence
_PRIOR_DRAWS = 25
_OPEN = 0.8  # posterior sd over the prior's, of a constant that the tests leave open
_NEAR = 2.0  # sds from zero
_SMALL = 0.5  # of a prior's size
_TOGETHER_TOO_MUCH = 0.99  # correlation
_LOW = 4.0  # log evidence below the first, at which a hump is left out
_FAR = 4.0  # sds between two humps
_RIDGE = 1e4  # condition number of the correlations


@dataclass(frozen=True)
class LaplaceCheck:
    """Log evidence by importance sampling with its standard error, and doubts about Laplace's.

    effective_draws: what the draws are worth; reasons: in words, none if all is well.
    """

    log_evidence: float
    error: float
    effective_draws: float
    reasons: tuple[str, ...]


def laplace_check(
    ensemble: Ensemble, point: Point, *, draws: int = DRAWS, seed: int = 0
) -> LaplaceCheck:
    """Sample about an optimum and look at its covariance."""
    free = point.subset.theta
    around = multivariate_t(point.theta[free], _spread(point.covariance), df=_TAIL, seed=seed)
    places = around.rvs(draws).reshape(draws, free.size)
    thetas = np.tile(point.theta, (draws, 1))
    thetas[:, free] = places
    logs = log_densities(ensemble, point, thetas) - around.logpdf(places)
    total = float(logsumexp(logs))
    effective = float(np.exp(2.0 * total - logsumexp(2.0 * logs)))
    return LaplaceCheck(
        total - math.log(draws),
        math.sqrt(max(1.0 / effective - 1.0 / draws, 0.0)),
        effective,
        (
            *_shape(effective, draws, point.log_evidence - total + math.log(draws)),
            *_bounds(ensemble, point),
            *_ridges(ensemble, point),
        ),
    )


def sampled_evidence(ensemble: Ensemble, point: Point) -> float:
    """Log evidence by importance sampling, or Laplace's if the draws are worth little and say more.

    They are worth little where one far out outweighs all others: then they say too much by chance.
    """
    found = laplace_check(ensemble, point)
    if found.effective_draws < _FEW * DRAWS:
        return min(found.log_evidence, point.log_evidence)
    return found.log_evidence


def evidence_of_humps(ensemble: Ensemble, tops: Sequence[Point]) -> float:
    """Log evidence of a density with these tops, the highest first; each hump counts once.

    Humps far below the first have no part in it, nor has a top that lies on another one's hump.
    """
    counted: list[Point] = []
    for top in tops:
        matters = top.log_evidence > tops[0].log_evidence - _LOW
        if not counted or (matters and all(_apart(top, other) for other in counted)):
            counted.append(top)
    return float(logsumexp([sampled_evidence(ensemble, top) for top in counted]))


def _apart(one: Point, two: Point) -> bool:
    """Whether either lies far out by the other's curvature."""
    gap = (one.theta - two.theta)[one.subset.theta]
    return bool(min(gap @ one.curvature @ gap, gap @ two.curvature @ gap) > _FAR**2)


def _spread(covariance: np.ndarray) -> np.ndarray:
    """The covariance, no direction wider than theta has room for or too narrow to compute with."""
    values, vectors = np.linalg.eigh(covariance)
    widest = min(float(values[-1]), _WIDEST**2)
    return (vectors * np.clip(values, _NARROWEST * widest, widest)) @ vectors.T


def _shape(effective: float, draws: int, excess: float) -> list[str]:
    """Doubts of the normal shape."""
    found = []
    if effective < _FEW * draws:
        found.append(
            f"its posterior is far from normal: {draws} draws are worth {effective:.0f}, so that "
            "the evidence is rough"
        )
    if abs(excess) > _APART:
        found.append(
            f"Laplace's log evidence is {abs(excess):.1f} too {'high' if excess > 0 else 'low'}"
        )
    return found


def _bounds(ensemble: Ensemble, point: Point) -> list[str]:
    """Constants that the tests leave open, or that lie against the end of their range."""
    found = []
    sds = dict(zip(point.subset.theta, np.sqrt(np.diag(point.covariance)), strict=True))
    for place, prior in _free(ensemble, point):
        widths = np.std(ensemble.draw(_PRIOR_DRAWS)[:, list(place.theta)], axis=0)
        low = [ensemble.names[k] for k in place.constants if _at_zero(point, k, prior)]
        if low:
            found += [f"{name} lies against zero" for name in low]
        elif all(sds[k] > _OPEN * w for k, w in zip(place.theta, widths, strict=True)):
            found.append(f"the tests say no more of {_name(ensemble, place)} than its prior")
    return found


def _at_zero(point: Point, k: int, prior: AbstractPrior) -> bool:
    """Whether a constant is within two sds of a zero at which its prior does not vanish."""
    if not isinstance(prior, HalfNormal | Dirichlet):
        return False
    size = float(prior.sd) if isinstance(prior, HalfNormal) else 1.0
    value, error = point.constants[k], point.constants_sds[k]
    return bool(0.0 < value < min(_NEAR * error, _SMALL * size))


def _ridges(ensemble: Ensemble, point: Point) -> list[str]:
    """Constants that move together, and combinations that nothing holds."""
    sds = np.sqrt(np.diag(point.covariance))
    correlation = point.covariance / np.outer(sds, sds)
    names = [_name(ensemble, place) for place, _ in _free(ensemble, point) for _ in place.theta]
    rows, columns = np.nonzero(np.triu(np.abs(correlation), 1) > _TOGETHER_TOO_MUCH)
    strongest = float(np.abs(correlation[rows, columns]).max(initial=0.0))
    tied = list(dict.fromkeys(names[k] for k in sorted({*rows.tolist(), *columns.tolist()})))
    # one name may stand for several numbers
    said = f"the constants {tied[0]}" if len(tied) == 1 else joined(tied)
    found = [f"{said} trade off (correlations up to {strongest:.3f})"] if tied else []
    if not found and np.linalg.cond(correlation) > _RIDGE:
        found.append("a combination of its constants is hardly determined")
    return found


def _free(ensemble: Ensemble, point: Point) -> list[tuple[Place, AbstractPrior]]:
    """The free fields of a point and their priors."""
    whole = ensemble.posterior
    leaves = jax.tree.leaves((whole.model, whole.noise), is_leaf=is_prior)
    free = set(point.subset.theta.tolist())
    return [
        (place, leaf)
        for place, leaf in zip(ensemble.places, leaves, strict=True)
        if len(place.theta) and place.theta[0] in free
    ]


def _name(ensemble: Ensemble, place: Place) -> str:
    """A field's name, without an index."""
    return ensemble.names[place.constants.start].partition("[")[0]


def log_densities(ensemble: Ensemble, point: Point, thetas: np.ndarray) -> np.ndarray:
    """(N,) log densities of the point's subset at thetas (N, D), on the smallest part."""
    whole = ensemble.posterior
    log_priors, constants = priors(whole, thetas)
    nulled = point.subset.nulled(np.asarray(constants))
    effects = point.subset.effects
    part = next(part for part in ensemble.parts if effects <= part.effects)
    found = likelihoods(part.posterior, nulled[:, part.constants])
    total = np.asarray(found) + np.asarray(log_priors)[:, point.subset.priors].sum(axis=1)
    return np.where(np.isfinite(total), total, -np.inf)


@compiled
def priors(posterior: Posterior, thetas: Array) -> tuple[Array, Array]:
    """(N, L) log densities of the priors and (N, P) constants."""
    return jax.vmap(lambda x: (posterior.log_priors(x), posterior.constants(x)))(thetas)


@compiled
def likelihoods(posterior: Posterior, constants: Array) -> Array:
    """(N,) log likelihoods of constants (N, P)."""

    def one(x: Array) -> Array:
        model, noise = posterior.with_constants(x)
        residuals = posterior.record.blocks.force - posterior.predict_with(model)
        return jnp.sum(jax.vmap(noise.log_likelihoods)(residuals, posterior.record.blocks))

    return jax.lax.map(one, constants, batch_size=_TOGETHER)
