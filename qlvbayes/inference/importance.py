r"""The evidence of a hypothesis by adaptive importance sampling, with its error.

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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

from qlvbayes.inference.density import Density
from qlvbayes.inference.evidence import Evidence
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
    """Log evidence, by_size (S,) of each size of the discrepancy, its error, effective draws."""

    log: float
    by_size: Array
    error: float
    effective: float


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
    rng = np.random.default_rng(seed)
    own = found[0][0].point.own
    clouds, shares = _about(found)
    used: list[tuple[Cloud, int]] = []
    thetas, heights = np.zeros((0, own.size)), np.zeros((0, density.discrepancy.sizes.size))
    best: Sampled | None = None
    for _ in range(_ROUNDS):
        counts = np.maximum(np.round(_ROUND * shares).astype(int), 1)
        used += list(zip(clouds, counts.tolist(), strict=True))
        fresh = np.concatenate([c.draw(n, rng) for c, n in zip(clouds, counts, strict=True)])
        thetas = np.concatenate([thetas, fresh])
        heights = np.concatenate([heights, density.log_density(own, fresh, tolerance)])
        weights = heights - _mixture(used, thetas)[:, None]
        best = _summed(weights)
        if best.error < close and best.effective >= _FEWEST:
            break
        after = _after(thetas, logsumexp(weights, axis=1))
        if after is not None:
            clouds, shares = [*clouds[: len(found)], after], np.append(shares[: len(found)], 0.0)
            shares = 0.5 * shares / shares.sum()
            shares[-1] = 0.5
    return best if best is not None and best.effective >= _FEWEST else None


def _about(found: Sequence[tuple[Mode, Evidence]]) -> tuple[list[Cloud], Array]:
    """A cloud about each mode that counts, and the share of the draws that it gives."""
    logs = np.array([evidence.log for _, evidence in found])
    near = [pair for pair, log in zip(found, logs, strict=True) if log > logs.max() - _NEAR]
    clouds = []
    for mode, evidence in near:
        root = _root(evidence.covariance)
        clouds.append(Cloud(mode.point.own.within(evidence.mean), root))
    shares = np.exp(logs[logs > logs.max() - _NEAR] - logs.max())
    shares = np.maximum(shares, _LEAST_SHARE)
    return clouds, shares / shares.sum()


def _root(covariance: Array) -> Array:
    """Lower root of a covariance, made positive definite where rounding left it."""
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


def _summed(weights: Array) -> Sampled:
    """Of log weights (K, S) at each size."""
    count = len(weights)
    whole = logsumexp(weights, axis=1)
    log = float(logsumexp(whole)) - math.log(count)
    if not math.isfinite(log):
        return Sampled(-math.inf, np.full(weights.shape[1], -math.inf), math.inf, 0.0)
    ratio = np.exp(whole - log)  # of mean 1
    error = float(ratio.std() / math.sqrt(count))
    by_size = np.asarray(logsumexp(weights, axis=0) - math.log(count))
    return Sampled(log, by_size, error, count / float(np.mean(ratio**2)))


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
    return Cloud(centre, _root((weights[:, None] * apart).T @ apart))
