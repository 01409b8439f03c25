r"""Draw from a hypothesis's posterior by adaptive importance sampling.

The draws give the evidence with a standard error. They come from Student-t distributions about the
modes, later also from one with the mean and covariance of the earlier draws. Each parameter is
drawn given the ones before it and truncated at its bounds (as Geweke, Hajivassiliou and Keane do
with a normal; Genz & Bretz 2009, doi:10.1007/978-3-642-01689-9). All draws are weighted by the
mixture q that they came from (Cornuet et al. 2012, doi:10.1111/j.1467-9469.2011.00756.x),

.. math:: Z \approx \frac1N \sum_k w_k, \quad w_k = \frac{p(\theta_k)}{q(\theta_k)}, \quad
          \text{error of } \ln Z = \frac{\text{sd}(w)}{\sqrt N\, \bar w},

where the density p is summed over the sizes of the discrepancy, and amplitudes exclude what is too
small to matter (`amplitude_prior`).
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
from qlvbayes.io.arrays import Array

CLOSE = 0.1
"""Standard error of a log evidence that is small enough: 10 % of a probability."""

_TAIL = 5.0  # degrees of freedom of a Student-t: heavier tails than a posterior has
_ROUND = 64  # draws in a round
_ROUNDS = 5
_MAX_ADAPTATIONS = 2
_GOOD = 0.2  # effective draws per draw above which proposals are not adapted
_FEWEST = 10.0  # effective draws below which a standard error cannot be trusted
_SPREAD = 3.0  # effective draws per parameter that a covariance needs
_BEYOND = 2.0  # sds that the centre of a proposal may lie beyond a bound
_LEAST_SHARE = 0.1  # draws about a mode over those about the best one, at least
_NEAR = 6.0  # log evidence below the best mode at which another mode is left out


class BoundedStudentT(NamedTuple):
    """A proposal distribution: Student-t in each parameter given the previous ones, within bounds.

    centre (F,), root (F, F) with scale matrix root root^T, lowest and highest (F,): of the
    parameters in the order in which they are drawn, those with bounds first; order (F,): their
    indices in theta.
    """

    centre: Array
    root: Array
    lowest: Array
    highest: Array
    order: NDArray[np.intp]

    @classmethod
    def from_covariance(
        cls,
        centre: Array,
        covariance: Array,
        lowest: Array | None = None,
        highest: Array | None = None,
    ) -> BoundedStudentT:
        """Return the proposal of a scale matrix (F, F), repaired where rounding spoilt it."""
        low = np.full(centre.size, -math.inf) if lowest is None else lowest
        high = np.full(centre.size, math.inf) if highest is None else highest
        order = np.argsort(~(np.isfinite(low) | np.isfinite(high)), kind="stable")
        root = _root(covariance[np.ix_(order, order)])
        return cls(centre[order], root, low[order], high[order], order)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Return draws (count, F)."""
        shares = rng.random((count, self.centre.size))
        steps, thetas = np.zeros_like(shares), np.zeros_like(shares)
        for k in range(self.centre.size):
            low, high, turned = self._between(steps, k)
            below, above = stdtr(_TAIL, low), stdtr(_TAIL, high)
            share = np.where(
                turned, 1.0 - shares[:, k], shares[:, k]
            )  # mirrored bounds use the same draw
            quantile = stdtrit(_TAIL, below + share * (above - below))
            steps[:, k] = np.where(turned, -quantile, quantile)
        drawn = self.centre + steps @ self.root.T
        thetas[:, self.order] = np.clip(drawn, self.lowest, self.highest)
        return thetas

    def log_density(self, thetas: Array) -> Array:
        """Return the log density (K,) at thetas (K, F), minus infinity beyond the bounds."""
        ordered = thetas[:, self.order]
        steps = solve_triangular(self.root, (ordered - self.centre).T, lower=True).T
        height = gammaln(0.5 * (_TAIL + 1.0)) - gammaln(0.5 * _TAIL)
        height -= 0.5 * math.log(_TAIL * math.pi)
        log = self.centre.size * height - np.log(np.diag(self.root)).sum()
        log -= 0.5 * (_TAIL + 1.0) * np.log1p(steps**2 / _TAIL).sum(axis=1)
        for k in range(self._bounded):
            low, high, _ = self._between(steps, k)
            log -= np.log(np.maximum(stdtr(_TAIL, high) - stdtr(_TAIL, low), 1e-300))
        inside = np.all((ordered >= self.lowest) & (ordered <= self.highest), axis=1)
        return np.where(inside, log, -math.inf)

    @property
    def _bounded(self) -> int:
        """Return how many parameters have bounds."""
        return int(np.sum(np.isfinite(self.lowest) | np.isfinite(self.highest)))

    def _between(self, steps: Array, k: int) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return bounds (K,) of parameter k in its own scale, given the steps (K, F) before it."""
        mean = self.centre[k] + steps[:, :k] @ self.root[k, :k]
        low, high = ((bound[k] - mean) / self.root[k, k] for bound in (self.lowest, self.highest))
        turned = low > 0.0
        return np.where(turned, -high, low), np.where(turned, -low, high), turned


Mixture = Sequence[tuple[BoundedStudentT, float]]
"""Proposals with their shares of the draws, which sum to 1."""


@dataclass(frozen=True, eq=False)
class ImportanceSample:
    """Weighted draws of a posterior, and the log evidence with its standard error."""

    log: float
    by_size: Array  # (S,): log evidence of each size of the discrepancy
    error: float
    effective: float  # effective number of draws
    thetas: Array  # (K, F): the draws
    weights: Array  # (K,): their weights, which sum to 1


def sampled_evidence(
    density: Density,
    modes: Sequence[tuple[Mode, Evidence]],
    tolerance: float,
    max_error: float = CLOSE,
    seed: int = 0,
) -> ImportanceSample | None:
    """Return the evidence of a hypothesis by sampling about its modes; None if few draws count."""

    def is_sufficient(so_far: ImportanceSample) -> bool:
        return so_far.error < max_error and so_far.effective >= _FEWEST

    parameters, rng = modes[0][0].point.own, np.random.default_rng(seed)
    points = [mode.point for mode, _ in modes]
    counts = np.isfinite([own.by_size for _, own in modes]).any(axis=0)
    sizes = np.flatnonzero(counts).tolist()
    best = importance_sample(
        density,
        parameters,
        mixture_about(modes),
        points,
        is_sufficient,
        _ROUNDS,
        rng,
        tolerance,
        sizes,
    )
    return best if best.effective >= _FEWEST else None


def importance_sample(
    density: Density,
    parameters: Parameters,
    start: Mixture,
    points: Sequence[Point],
    is_sufficient: Callable[[ImportanceSample], bool],
    rounds: int,
    rng: np.random.Generator,
    tolerance: float = 0.0,
    sizes: Sequence[int] | None = None,
) -> ImportanceSample:
    """Return draws of the last mixture of proposals, when they suffice or ``rounds`` are over.

    ``sizes`` are the indices of the discrepancy's sizes that are summed over, by default all.
    """
    proposals, adaptations = list(start), 0
    thetas = np.zeros((0, parameters.size))
    heights = np.zeros((0, density.discrepancy.sizes.size))
    first = 0  # row of the first draw of the present mixture
    for round_number in range(1, rounds + 1):
        fresh = np.concatenate([one.draw(count, rng) for one, count in _counts(proposals)])
        thetas = np.concatenate([thetas, fresh])
        fresh_heights = density.log_density(parameters, fresh, tolerance, points, sizes)
        heights = np.concatenate([heights, fresh_heights])
        logs = heights[first:] - _mixture(proposals, thetas[first:])[:, None]
        best = _summed(thetas[first:], logs)
        if round_number == rounds or is_sufficient(best):
            break
        if adaptations < _MAX_ADAPTATIONS and best.effective < _GOOD * len(logs):
            all_logs = logsumexp(heights, axis=1) - _mixture(proposals, thetas)
            adapted = _after(parameters, thetas, all_logs)
            if adapted is not None:
                proposals = [*((one, 0.5 * share) for one, share in start), (adapted, 0.5)]
                adaptations, first = adaptations + 1, len(thetas)
    return best


def mixture_about(modes: Sequence[tuple[Mode, Evidence]]) -> Mixture:
    """Return a mixture of a proposal about each mode that matters."""
    highest = max(evidence.log for _, evidence in modes)
    likely = [(mode, evidence) for mode, evidence in modes if evidence.log > highest - _NEAR]
    shares = np.maximum(np.exp([evidence.log - highest for _, evidence in likely]), _LEAST_SHARE)
    proposals = [_about(mode.point.own, evidence) for mode, evidence in likely]
    return list(zip(proposals, (shares / shares.sum()).tolist(), strict=True))


def _about(parameters: Parameters, evidence: Evidence) -> BoundedStudentT:
    """Return the proposal about one mode; its centre may lie a little beyond the bounds."""
    margin = _BEYOND * np.sqrt(np.diag(evidence.covariance))
    centre = np.clip(evidence.mean, parameters.lowest - margin, parameters.highest + margin)
    return BoundedStudentT.from_covariance(
        centre, evidence.covariance, parameters.lowest, parameters.highest
    )


def _root(covariance: Array) -> Array:
    """Return the lower triangular root of a covariance (F, F)."""
    sds = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(sds, sds))
    half = sds[:, None] * vectors * np.sqrt(np.maximum(values, 1e-10))
    root = np.asarray(np.linalg.qr(half.T, mode="r")).T
    return np.asarray(root * np.sign(np.diag(root)))


def _counts(proposals: Mixture) -> list[tuple[BoundedStudentT, int]]:
    """Return each proposal with the number of draws that it gives in a round."""
    return [(proposal, max(round(_ROUND * share), 1)) for proposal, share in proposals]


def _mixture(proposals: Mixture, thetas: Array) -> Array:
    """Return the log density (K,) at thetas (K, F) of the mixture from which draws come."""
    counts = _counts(proposals)
    total = sum(count for _, count in counts)
    logs = [proposal.log_density(thetas) + math.log(count / total) for proposal, count in counts]
    return np.asarray(np.logaddexp.reduce(logs, axis=0))


def _summed(thetas: Array, logs: Array) -> ImportanceSample:
    """Return the importance sample of draws (K, F) with log weights (K, S) for each size."""
    count = len(logs)
    log_weights = logsumexp(logs, axis=1)
    log = float(logsumexp(log_weights)) - math.log(count)
    if not math.isfinite(log):
        nothing = np.full(logs.shape[1], -math.inf)
        return ImportanceSample(-math.inf, nothing, math.inf, 0.0, thetas, np.zeros(count))
    ratio = np.exp(log_weights - log)  # of mean 1
    error = float(ratio.std() / math.sqrt(count))
    by_size = np.asarray(logsumexp(logs, axis=0) - math.log(count))
    effective = count / float(np.mean(ratio**2))
    return ImportanceSample(log, by_size, error, effective, thetas, ratio / count)


def _after(own: Parameters, thetas: Array, logs: Array) -> BoundedStudentT | None:
    """Return a proposal of weighted draws' mean and covariance; uneven weights are tempered."""
    finite = np.isfinite(logs)
    if not finite.any():
        return None
    thetas, logs = thetas[finite], logs[finite]
    wanted = min(_SPREAD * thetas.shape[1], 0.5 * len(thetas))
    weights = np.exp(logs - logsumexp(logs))
    while 1.0 / np.sum(weights**2) < wanted:
        logs = 0.5 * logs
        weights = np.exp(logs - logsumexp(logs))
    centre = weights @ thetas
    offset = thetas - centre
    return BoundedStudentT.from_covariance(
        centre, (weights[:, None] * offset).T @ offset, own.lowest, own.highest
    )
