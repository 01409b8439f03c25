r"""Posterior draws of a hypothesis by adaptive importance sampling, and its evidence with an error.

Draws come from Student-t distributions about the modes, later ones also from one of the mean and
covariance of those before. All are weighed by the mixture q that they came from (Cornuet et al.
2012, doi:10.1111/j.1467-9469.2011.00756.x),

.. math:: Z \approx \frac1N \sum_k w_k, \quad w_k = \frac{p(\theta_k)}{q(\theta_k)}, \quad
          \text{error of } \ln Z = \frac{\text{sd}(w)}{\sqrt N\, \bar w},

with the density p summed over the sizes of the discrepancy and with what is too small to matter
left out of amplitudes (of `noticeable`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

from qlvbayes.inference.density import Density
from qlvbayes.inference.evidence import Evidence
from qlvbayes.inference.hypothesis import Parameters
from qlvbayes.inference.modes import Mode

Array = NDArray[np.float64]

CLOSE = 0.1
"""Error of a log evidence that does: 10 % of a probability."""

_TAIL = 5.0  # degrees of freedom of a Student-t: heavier tails than a posterior has
_ROUND = 64  # draws
_ROUNDS = 5
_FEWEST = 10.0  # effective draws, below which an error is not to be trusted
_SPREAD = 3.0  # effective draws a number, behind a covariance
_LEAST_SHARE = 0.1  # of the draws about the least of the modes
_NEAR = 6.0  # log evidence behind the best mode, at which another is left out


class Cloud(NamedTuple):
    """A Student-t: centre (F,), and a root (F, F) of its scale matrix, root root^T."""

    centre: Array
    root: Array

    @classmethod
    def of(cls, centre: Array, covariance: Array) -> Cloud:
        """With a scale matrix (F, F), made positive definite where rounding left it."""
        return cls(centre, _root(covariance))

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count, F)."""
        normal = rng.standard_normal((count, self.centre.size))
        wide = np.sqrt(_TAIL / rng.chisquare(_TAIL, count))
        return np.asarray(self.centre + wide[:, None] * (normal @ self.root.T))

    def log_density(self, thetas: Array) -> Array:
        """(K,) at (K, F)."""
        count = self.centre.size
        apart = solve_triangular(self.root, (thetas - self.centre).T, lower=True)
        height = gammaln(0.5 * (_TAIL + count)) - gammaln(0.5 * _TAIL)
        height -= 0.5 * count * math.log(_TAIL * math.pi) + np.log(np.diag(self.root)).sum()
        tail = 0.5 * (_TAIL + count) * np.log1p((apart**2).sum(axis=0) / _TAIL)
        return np.asarray(height - tail)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Log evidence, by_size (S,) of each size of the discrepancy, its error, effective draws.

    thetas (K, F): the draws; weights (K,): theirs, which sum to 1.
    """

    log: float
    by_size: Array
    error: float
    effective: float
    thetas: Array
    weights: Array


def sampled_evidence(
    density: Density,
    found: Sequence[tuple[Mode, Evidence]],
    tolerance: float,
    close: float = CLOSE,
    seed: int = 0,
) -> Sampled | None:
    """From a hypothesis's modes with their Laplace evidences; None where too few draws count.

    tolerance: share of the peak force from which an amplitude matters; close: error that does.
    """

    def does(so_far: Sampled) -> bool:
        return so_far.error < close and so_far.effective >= _FEWEST

    own, rng = found[0][0].point.own, np.random.default_rng(seed)
    best = sample(density, own, about(found), does, _ROUNDS, rng, tolerance)
    return best if best.effective >= _FEWEST else None


def sample(
    density: Density,
    own: Parameters,
    start: Sequence[tuple[Cloud, float]],
    does: Callable[[Sampled], bool],
    rounds: int,
    rng: np.random.Generator,
    tolerance: float = 0.0,
) -> Sampled:
    """Until the draws do or ``rounds`` are over; start: clouds and their shares, which sum to 1."""
    clouds = list(start)
    used: list[tuple[Cloud, int]] = []
    thetas, heights = np.zeros((0, own.size)), np.zeros((0, density.discrepancy.sizes.size))
    for left in reversed(range(rounds)):
        some = [(cloud, max(round(_ROUND * share), 1)) for cloud, share in clouds]
        used += some
        fresh = np.concatenate([cloud.draw(count, rng) for cloud, count in some])
        thetas = np.concatenate([thetas, fresh])
        heights = np.concatenate([heights, density.log_density(own, fresh, tolerance)])
        logs = heights - _mixture(used, thetas)[:, None]
        best = _summed(thetas, logs)
        if not left or does(best):
            break
        after = _after(thetas, logsumexp(logs, axis=1))
        if after is not None:
            clouds = [*((cloud, 0.5 * share) for cloud, share in start), (after, 0.5)]
    return best


def about(found: Sequence[tuple[Mode, Evidence]]) -> list[tuple[Cloud, float]]:
    """A cloud about each mode that counts, and the share of the draws that it gives."""
    highest = max(told.log for _, told in found)
    near = [(mode, told) for mode, told in found if told.log > highest - _NEAR]
    shares = np.maximum(np.exp([told.log - highest for _, told in near]), _LEAST_SHARE)
    clouds = [Cloud.of(mode.point.own.within(told.mean), told.covariance) for mode, told in near]
    return list(zip(clouds, (shares / shares.sum()).tolist(), strict=True))


def _root(covariance: Array) -> Array:
    """Lower root of a covariance."""
    sds = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(sds, sds))
    half = sds[:, None] * vectors * np.sqrt(np.maximum(values, 1e-10))
    root = np.asarray(np.linalg.qr(half.T, mode="r")).T
    return np.asarray(root * np.sign(np.diag(root)))


def _mixture(used: Sequence[tuple[Cloud, int]], thetas: Array) -> Array:
    """(K,) log density of the mixture of all clouds, each with as many draws as it gave."""
    total = sum(count for _, count in used)
    each = [cloud.log_density(thetas) + math.log(count / total) for cloud, count in used]
    return np.asarray(np.logaddexp.reduce(each, axis=0))


def _summed(thetas: Array, logs: Array) -> Sampled:
    """Of draws and their log weights (K, S) at each size."""
    count = len(logs)
    whole = logsumexp(logs, axis=1)
    log = float(logsumexp(whole)) - math.log(count)
    if not math.isfinite(log):
        nothing = np.full(logs.shape[1], -math.inf)
        return Sampled(-math.inf, nothing, math.inf, 0.0, thetas, np.zeros(count))
    ratio = np.exp(whole - log)  # of mean 1
    error = float(ratio.std() / math.sqrt(count))
    by_size = np.asarray(logsumexp(logs, axis=0) - math.log(count))
    effective = count / float(np.mean(ratio**2))
    return Sampled(log, by_size, error, effective, thetas, ratio / count)


def _after(thetas: Array, logs: Array) -> Cloud | None:
    """The cloud with the mean and covariance of weighted draws; uneven weights are tempered."""
    real = np.isfinite(logs)
    if not real.any():
        return None
    thetas, logs = thetas[real], logs[real]
    wanted = min(_SPREAD * thetas.shape[1], 0.5 * len(thetas))
    weights = np.exp(logs - logsumexp(logs))
    while 1.0 / np.sum(weights**2) < wanted:
        logs = 0.5 * logs
        weights = np.exp(logs - logsumexp(logs))
    centre = weights @ thetas
    apart = thetas - centre
    return Cloud.of(centre, (weights[:, None] * apart).T @ apart)
