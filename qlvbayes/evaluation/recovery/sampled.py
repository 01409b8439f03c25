r"""Posterior quantiles by importance sampling about the tops of a posterior.

The first draws come from a Student-t about each top, with the curvature's covariance; the next ones
from one with the mean and covariance of those before, until they are worth enough. All are weighed
by the mixture of all that they came from (Cornuet et al. 2012,
doi:10.1111/j.1467-9469.2011.00756.x):

.. math:: w = L(\theta) \pi(\theta) / \textstyle\sum_j n_j q_j(\theta)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from qlvbayes.evaluation.recovery.clouds import Cloud

TOGETHER = 200
"""Draws a round."""

_ROUNDS = 30
_WORTH = 100.0  # effective draws that do
_LEAST = 25.0  # effective draws behind a covariance, however uneven the weights

Judge = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""(N, F) free numbers to (N,) log densities and (N, C) constants."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Constants (N, C) of draws, and the draws' weights (N,), which sum to 1."""

    constants: np.ndarray
    weights: np.ndarray

    @property
    def worth(self) -> float:
        """Effective number of draws, 1 / sum w^2."""
        return _worth(self.weights)

    def quantiles(self, shares: tuple[float, ...]) -> np.ndarray:
        """(len(shares), C) quantiles of each constant."""
        kept = self.weights > 0.0
        columns, weights = self.constants[kept].T, self.weights[kept]
        return np.array([_quantiles(column, weights, shares) for column in columns]).T


def sample(judge: Judge, clouds: list[Cloud], rng: np.random.Generator) -> Sample:
    """Sample a posterior from clouds about its tops, two kinds of each, and those that follow."""
    fresh = _shared(clouds, TOGETHER)
    used, draws, found = [], [], []
    for _ in range(_ROUNDS):
        used += fresh
        draws.append(np.concatenate([cloud.draw(size, rng) for cloud, size in fresh]))
        found.append(judge(draws[-1]))
        logs = np.concatenate([log for log, _ in found])
        weights = _weights(np.concatenate(draws), logs, used)
        if _worth(weights) >= _WORTH:
            break
        after = _after(clouds[:2], np.concatenate(draws), weights)
        fresh = _shared(after, TOGETHER // 2) + _shared(clouds, TOGETHER // 2)
    return Sample(np.concatenate([constants for _, constants in found]), weights)


def _weights(draws: np.ndarray, logs: np.ndarray, used: list[tuple[Cloud, int]]) -> np.ndarray:
    """(N,) weights of draws from the mixture of the clouds."""
    real = np.isfinite(logs)
    each = [cloud.log_density(draws[real]) + np.log(size) for cloud, size in used]
    found = np.full(len(draws), -np.inf)
    found[real] = logs[real] - np.logaddexp.reduce(each, axis=0)
    return np.exp(found - logsumexp(found))


def _shared(clouds: list[Cloud], count: int) -> list[tuple[Cloud, int]]:
    """The clouds, and how many draws each gives."""
    shares = np.array_split(np.arange(count), len(clouds))
    return [(cloud, share.size) for cloud, share in zip(clouds, shares, strict=True) if share.size]


def _after(kinds: list[Cloud], draws: np.ndarray, weights: np.ndarray) -> list[Cloud]:
    """Clouds with the draws' mean and covariance; one-sided weights are evened out."""
    real = weights > 0.0
    draws, weights = draws[real], weights[real]
    while _worth(weights) < min(_LEAST, 0.5 * weights.size):
        weights = np.sqrt(weights)
        weights /= weights.sum()
    return [kind.like(draws, weights) for kind in kinds]


def _worth(weights: np.ndarray) -> float:
    return float(1.0 / np.sum(weights**2))


def _quantiles(values: np.ndarray, weights: np.ndarray, shares: tuple[float, ...]) -> np.ndarray:
    order = np.argsort(values)
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(shares, below, values[order])
