r"""Posterior draws of a hypothesis by adaptive importance sampling, and its evidence with an error.

Draws come from Student-t distributions about the modes, later ones also from one of the mean and
covariance of those before; number by number, each about what those before it say and cut at its
bounds (as Geweke, Hajivassiliou and Keane do with a normal; Genz & Bretz 2009,
doi:10.1007/978-3-642-01689-9). All are weighed by the mixture q that they came from (Cornuet et al.
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
from scipy.special import gammaln, logsumexp, stdtr, stdtrit

from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.evidence import Evidence
from qlvbayes.inference.forward.hypothesis import Parameters
from qlvbayes.inference.modes import Mode

Array = NDArray[np.float64]

CLOSE = 0.1
"""Error of a log evidence that does: 10 % of a probability."""

_TAIL = 5.0  # degrees of freedom of a Student-t: heavier tails than a posterior has
_ROUND = 64  # draws
_ROUNDS = 5
_ADAPTED = 2  # times at most
_GOOD = 0.2  # effective draws a draw, from which the clouds stay as they are
_FEWEST = 10.0  # effective draws, below which an error is not to be trusted
_SPREAD = 3.0  # effective draws a number, behind a covariance
_BEYOND = 2.0  # sds beyond a bound, up to which a normal's mean is the centre of draws
_LEAST_SHARE = 0.1  # of the draws about the least of the modes
_NEAR = 6.0  # log evidence behind the best mode, at which another is left out


class Cloud(NamedTuple):
    """Where draws come from: each number Student-t about what those before it say, within bounds.

    centre (F,), root (F, F) of the scale matrix, root root^T, lowest and highest (F,): of numbers
    in the order in which they are drawn, those with bounds first; order (F,): their places.
    """

    centre: Array
    root: Array
    lowest: Array
    highest: Array
    order: NDArray[np.intp]

    @classmethod
    def of(
        cls,
        centre: Array,
        covariance: Array,
        lowest: Array | None = None,
        highest: Array | None = None,
    ) -> Cloud:
        """With a scale matrix (F, F), made positive definite where rounding left it."""
        low = np.full(centre.size, -math.inf) if lowest is None else lowest
        high = np.full(centre.size, math.inf) if highest is None else highest
        order = np.argsort(~(np.isfinite(low) | np.isfinite(high)), kind="stable")
        root = _root(covariance[np.ix_(order, order)])
        return cls(centre[order], root, low[order], high[order], order)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count, F)."""
        shares = rng.random((count, self.centre.size))
        apart, found = np.zeros_like(shares), np.zeros_like(shares)
        for k in range(self.centre.size):
            low, high, turned = self._between(apart, k)
            below, above = stdtr(_TAIL, low), stdtr(_TAIL, high)
            share = np.where(turned, 1.0 - shares[:, k], shares[:, k])  # one draw, either way about
            number = stdtrit(_TAIL, below + share * (above - below))
            apart[:, k] = np.where(turned, -number, number)
        drawn = self.centre + apart @ self.root.T
        found[:, self.order] = np.clip(drawn, self.lowest, self.highest)
        return found

    def log_density(self, thetas: Array) -> Array:
        """(K,) at (K, F); minus infinity beyond the bounds."""
        places = thetas[:, self.order]
        apart = solve_triangular(self.root, (places - self.centre).T, lower=True).T
        height = gammaln(0.5 * (_TAIL + 1.0)) - gammaln(0.5 * _TAIL)
        height -= 0.5 * math.log(_TAIL * math.pi)
        found = self.centre.size * height - np.log(np.diag(self.root)).sum()
        found -= 0.5 * (_TAIL + 1.0) * np.log1p(apart**2 / _TAIL).sum(axis=1)
        for k in range(self._bounded):
            low, high, _ = self._between(apart, k)
            found -= np.log(np.maximum(stdtr(_TAIL, high) - stdtr(_TAIL, low), 1e-300))
        inside = np.all((places >= self.lowest) & (places <= self.highest), axis=1)
        return np.where(inside, found, -math.inf)

    @property
    def _bounded(self) -> int:
        """Numbers with bounds."""
        return int(np.sum(np.isfinite(self.lowest) | np.isfinite(self.highest)))

    def _between(self, apart: Array, k: int) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Bounds (K,) of the k-th number in its own scale, after the steps (K, F) before it.

        Turned about, where they lie above zero, to the tail whose probabilities keep their digits.
        """
        mean = self.centre[k] + apart[:, :k] @ self.root[k, :k]
        low, high = ((bound[k] - mean) / self.root[k, k] for bound in (self.lowest, self.highest))
        turned = low > 0.0
        return np.where(turned, -high, low), np.where(turned, -low, high), turned


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
    points = [mode.point for mode, _ in found]
    best = sample(density, own, about(found), points, does, _ROUNDS, rng, tolerance)
    return best if best.effective >= _FEWEST else None


def sample(
    density: Density,
    own: Parameters,
    start: Sequence[tuple[Cloud, float]],
    points: Sequence[Point],
    does: Callable[[Sampled], bool],
    rounds: int,
    rng: np.random.Generator,
    tolerance: float = 0.0,
) -> Sampled:
    """Until the draws do or ``rounds`` are over; start: clouds and their shares, which sum to 1.

    points: the modes, as at the nearest of which the discrepancy is separated.

    What counts are the draws of the last mixture, as chosen before them: clouds laid about draws
    that have been weighed make these too light (by 0.2 of ln Z in twelve numbers).
    """
    clouds, adapted = list(start), 0
    seen, seen_heights = np.zeros((0, own.size)), np.zeros((0, density.discrepancy.sizes.size))
    first = 0
    for done in range(1, rounds + 1):
        fresh = np.concatenate([cloud.draw(count, rng) for cloud, count in _counts(clouds)])
        seen = np.concatenate([seen, fresh])
        heights = density.log_density(own, fresh, tolerance, points)
        seen_heights = np.concatenate([seen_heights, heights])
        logs = seen_heights[first:] - _mixture(clouds, seen[first:])[:, None]
        best = _summed(seen[first:], logs)
        if done == rounds or does(best):
            break
        if adapted < _ADAPTED and best.effective < _GOOD * len(logs):
            every = logsumexp(seen_heights, axis=1) - _mixture(clouds, seen)
            after = _after(own, seen, every)
            if after is not None:
                clouds = [*((cloud, 0.5 * share) for cloud, share in start), (after, 0.5)]
                adapted, first = adapted + 1, len(seen)
    return best


def about(found: Sequence[tuple[Mode, Evidence]]) -> list[tuple[Cloud, float]]:
    """A cloud about each mode that counts, and the share of the draws that it gives."""
    highest = max(told.log for _, told in found)
    near = [(mode, told) for mode, told in found if told.log > highest - _NEAR]
    shares = np.maximum(np.exp([told.log - highest for _, told in near]), _LEAST_SHARE)
    clouds = [_about(mode.point.own, told) for mode, told in near]
    return list(zip(clouds, (shares / shares.sum()).tolist(), strict=True))


def _about(own: Parameters, told: Evidence) -> Cloud:
    """As the normal about a mode, whose mean may lie a little beyond the bounds."""
    little = _BEYOND * np.sqrt(np.diag(told.covariance))
    centre = np.clip(told.mean, own.lowest - little, own.highest + little)
    return Cloud.of(centre, told.covariance, own.lowest, own.highest)


def _root(covariance: Array) -> Array:
    """Lower root of a covariance."""
    sds = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(sds, sds))
    half = sds[:, None] * vectors * np.sqrt(np.maximum(values, 1e-10))
    root = np.asarray(np.linalg.qr(half.T, mode="r")).T
    return np.asarray(root * np.sign(np.diag(root)))


def _counts(clouds: Sequence[tuple[Cloud, float]]) -> list[tuple[Cloud, int]]:
    """How many draws of a round each cloud gives."""
    return [(cloud, max(round(_ROUND * share), 1)) for cloud, share in clouds]


def _mixture(clouds: Sequence[tuple[Cloud, float]], thetas: Array) -> Array:
    """(K,) log density of the mixture of clouds that draws come from."""
    counts = _counts(clouds)
    total = sum(count for _, count in counts)
    each = [cloud.log_density(thetas) + math.log(count / total) for cloud, count in counts]
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


def _after(own: Parameters, thetas: Array, logs: Array) -> Cloud | None:
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
    return Cloud.of(centre, (weights[:, None] * apart).T @ apart, own.lowest, own.highest)
