r"""Restricted likelihood of noise in all dwells together, O(n).

The precision P of the correlated process is banded. With D the white variance of the runs' means
and S the sd of the process's mean over a run,

.. math:: V = D + \rho\, S R S, \quad
          V^{-1} = D^{-1} - D^{-1} S (P/\rho + S D^{-1} S)^{-1} S D^{-1}

(Woodbury). Patterson & Thompson 1971,
doi:10.1093/biomet/58.3.545.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky, cholesky_banded, solve_triangular

from qlvbayes.io.arrays import Array
from qlvbayes.motion.noisefloor.averages import rate, variance
from qlvbayes.motion.noisefloor.dwells import Dwell, run_scale, trend

_NEAREST = 1e-9
"""Of the correlation time: between nearer readings a process moves by less than 2 % of the white
noise, however large it is, and the digits of its precision would not suffice."""


@dataclass(frozen=True)
class Pool:
    """Data of all dwells, one after another."""

    gaps: Array  # (n - 1,): time between neighbouring runs' middles (inf between dwells)
    # count, length (n,): readings in a run and its duration
    count: Array
    length: Array
    force: Array  # (n,): smooth force
    y: Array  # (n,): what the trends leave
    trends: list[Array]  # their orthonormal bases
    columns: Array
    freedom: int
    constant: float = 0.0  # of the log-likelihood, for relative sds

    @classmethod
    def from_dwells(cls, dwells: list[Dwell], ratio: float) -> Pool:
        """Return means over runs without trends; ``ratio`` of neighbouring relaxation times."""
        trends = [trend(dwell, ratio) for dwell in dwells]
        values = [dwell.mean(dwell.force) for dwell in dwells]
        scales = [run_scale(dwell) for dwell in dwells]
        middles = [dwell.mean(dwell.time) for dwell in dwells]
        left, smooth = [], []
        for q, value, scale in zip(trends, values, scales, strict=True):
            fitted = scale * (q @ (q.T @ (value / scale)))
            smooth.append(fitted)
            left.append((value - fitted) / scale)
        return cls(
            np.concatenate([np.append(np.diff(t), np.inf) for t in middles])[:-1],
            np.concatenate([dwell.count for dwell in dwells]),
            np.concatenate([dwell.length for dwell in dwells]),
            np.concatenate(smooth),
            np.concatenate([y - q @ (q.T @ y) for q, y in zip(trends, left, strict=True)]),
            trends,
            _side_by_side(trends),
            sum(q.shape[0] - q.shape[1] for q in trends),
        )

    def scaled(self, scale: Array) -> Pool:
        """Return the same data for noise whose sd is proportional to ``scale`` (n,)."""
        trends, y, constant, at = [], [], -float(np.log(scale).sum()), 0
        for q in self.trends:
            rows, at = slice(at, at + q.shape[0]), at + q.shape[0]
            own, r = np.linalg.qr(q / scale[rows, None])
            constant -= float(np.log(np.abs(np.diag(r))).sum())
            left = self.y[rows] / scale[rows]
            left = left - own @ (own.T @ left)
            trends.append(own)
            y.append(left)
        return Pool(
            self.gaps, self.count, self.length, self.force, np.concatenate(y), trends,
            _side_by_side(trends), self.freedom, constant,
        )  # fmt: skip

    def of_white(self) -> tuple[float, float]:
        """Return log-likelihood and variance of white noise alone."""
        return self._restricted(
            self.count[:, None] * self._coefficients(), -np.log(self.count).sum()
        )

    def likelihood(self, log_ratio: float, log_tau: float) -> tuple[float, float]:
        """Return the restricted log-likelihood (up to a constant) and the best white variance."""
        ratio, tau = np.exp(log_ratio), np.exp(log_tau)
        shrink = np.sqrt(np.real(variance(self.length, self.count, rate(tau, smooth=False))))
        band, log_precision = _precision(self.gaps / tau)
        band = band / ratio
        log_precision -= self.y.size * log_ratio
        band[-1] += shrink**2 * self.count
        factor = cholesky_banded(band, check_finite=False)
        z = self._coefficients()
        weighted = (shrink * self.count)[:, None] * z
        inner = cho_solve_banded((factor, False), weighted, check_finite=False)
        solved = self.count[:, None] * (z - shrink[:, None] * inner)
        log_det = 2.0 * float(np.log(factor[-1]).sum()) - log_precision
        return self._restricted(solved, log_det - float(np.log(self.count).sum()))

    def _coefficients(self) -> Array:
        return np.column_stack([self.y, self.columns])

    def _restricted(self, solved: Array, log_det: float) -> tuple[float, float]:
        """Return the restricted likelihood from V^-1 (y, trends) and log det V."""
        power, at = float(self.y @ solved[:, 0]), 0
        for q in self.trends:
            rows, at = slice(at, at + q.shape[0]), at + q.shape[0]
            gram = cholesky(q.T @ solved[rows, 1 : q.shape[1] + 1], lower=True, check_finite=False)
            moment = solve_triangular(gram, q.T @ solved[rows, 0], lower=True, check_finite=False)
            power -= float(moment @ moment)
            log_det += 2.0 * float(np.log(np.diag(gram)).sum())
        variance = max(power, float(np.finfo(np.float64).tiny)) / self.freedom
        return self.constant - 0.5 * (self.freedom * np.log(variance) + log_det), variance


def _side_by_side(trends: list[Array]) -> Array:
    width = max(q.shape[1] for q in trends)
    return np.concatenate([np.pad(q, ((0, 0), (0, width - q.shape[1]))) for q in trends])


def _precision(x: Array) -> tuple[Array, float]:
    """Return the upper band (2, n) of an OU process's precision, and its log det."""
    x = np.maximum(x, _NEAREST)
    a, left = np.exp(-x), -np.expm1(-2.0 * x)
    band = np.zeros((2, x.size + 1))
    band[1] = 1.0
    band[1, 1:] += a**2 / left
    band[1, :-1] += a**2 / left
    band[0, 1:] = -a / left
    return band, -float(np.log(left).sum())
