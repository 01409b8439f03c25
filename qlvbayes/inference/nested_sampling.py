r"""Compute the evidence by nested sampling, without Laplace's approximation.

.. math:: Z = \int L(\theta) \pi(\theta) d\theta = \int_0^1 L(X) dX

X is the share of the prior's mass with a higher likelihood than L. Live points move up through the
likelihood: the lowest ones are replaced, several at a time, by hit-and-run slice moves within the
region that is left (Skilling 2006, doi:10.1214/06-BA127; Neal 2003, doi:10.1214/aos/1056562461).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
from blackjax.ns.utils import finalise, log_weights
from jaxtyping import Array
from scipy.special import logsumexp

from qlvbayes.model.posterior import Posterior, draw_priors

LIVE = 80
_AT_ONCE = 4  # number of live points over the number replaced together
_MOVES = 2.0  # slice moves per parameter for one new point
_LEFT = -4.0  # log share of the evidence that may remain in the live points at the end
_SHUFFLES = 200  # draws of the unknown volumes
_WORST = -1e100  # log likelihood where the model's force is not finite


@dataclass(frozen=True, eq=False)
class NestedEvidence:
    """The result of a nested sampling run."""

    log_evidence: float
    error: float  # standard error of ``log_evidence``, from repeated draws of the unknown volumes X
    evaluations: int  # how many likelihoods were computed
    draws: np.ndarray  # (N, D): equally weighted posterior draws


class _Chunk(NamedTuple):
    """The state after one replacement, the points removed, and how many likelihoods it took."""

    state: Any
    dead: Any
    evaluations: Array


def nested_evidence(
    posterior: Posterior, seed: int = 0, *, live: int = LIVE, draws: int = 1000
) -> NestedEvidence:
    """Return the log evidence of a posterior, with its error and draws.

    The prior is that of the unbounded parameters theta. One step is compiled for all posteriors of
    one shape. A run takes about 300 000 likelihoods for ten parameters.
    """
    moves = max(5, round(_MOVES * posterior.size))
    together = max(live // _AT_ONCE, 1)
    key = jax.random.key(seed)
    start = jnp.asarray(draw_priors(posterior, live, np.random.default_rng(seed)))
    state = _start(posterior, start)
    dead, evaluations = [], live
    while float(state.integrator.logZ_live - state.integrator.logZ) > _LEFT:
        key, own = jax.random.split(key)
        chunk = _replace(posterior, own, state, moves, together)
        state = chunk.state
        dead.append(chunk.dead)
        evaluations += int(chunk.evaluations)
    return _judge(finalise(state, dead, update_info=False), key, evaluations, draws)


def _algorithm(posterior: Posterior, moves: int, together: int) -> Any:
    """Return blackjax's nested slice sampler for a posterior."""

    def log_likelihood(theta: Array) -> Array:
        total = posterior.log_likelihood(theta)
        return jnp.where(jnp.isfinite(total), total, _WORST)

    def log_prior(theta: Array) -> Array:
        return jnp.sum(posterior.log_priors(theta))

    return blackjax.nss(log_prior, log_likelihood, num_inner_steps=moves, num_delete=together)


@jax.jit
def _start(posterior: Posterior, positions: Array) -> Any:
    """Return the initial state of the sampler from live points (live, D)."""
    return _algorithm(posterior, 1, 1).init(positions)


@partial(jax.jit, static_argnames=("moves", "together"))
def _replace(posterior: Posterior, key: Array, state: Any, moves: int, together: int) -> _Chunk:
    """Return the state after the lowest live points were replaced, and what that took."""
    state, info = _algorithm(posterior, moves, together).step(key, state)
    # likelihoods at both ends of each bracket, and at each expansion and shrinkage
    taken = info.update_info.num_expansions + info.update_info.num_shrink + 2
    return _Chunk(state, info._replace(update_info=None), jnp.sum(taken))


def _judge(dead: Any, key: Array, evaluations: int, draws: int) -> NestedEvidence:
    """Return the evidence and posterior draws of all points that were removed."""
    one, two = jax.random.split(key)
    logs = np.asarray(log_weights(one, dead, shape=_SHUFFLES))
    totals = logsumexp(logs, axis=0)
    weights = np.exp(logs - totals).mean(axis=1)
    rows = jax.random.choice(two, weights.size, (draws,), p=jnp.asarray(weights))
    return NestedEvidence(
        log_evidence=float(totals.mean()),
        error=float(totals.std(ddof=1)),
        evaluations=evaluations,
        draws=np.asarray(dead.particles.position)[np.asarray(rows)],
    )
