r"""Restricted likelihood of noise in all dwells together, from means over their readings, O(n).

Of an Ornstein-Uhlenbeck process with the time tau, means over n readings, h apart, have with
rho = e^{-h/tau} the correlation a e^{-d/tau} with a reading d before (or behind) and the variance v

.. math:: a = \frac{1 - \rho^n}{n (1 - \rho)}, \quad
          v = \frac{1 + \rho - 2 \rho a}{n (1 - \rho)}

Few readings far apart average as independent ones: no integral over the stretch would say so. The
precision P of the process is banded. With D the white variance of the runs' means and S the sd of
the process's mean over a run,

.. math:: V = D + \rho\, S R S, \quad
          V^{-1} = D^{-1} - D^{-1} S (P/\rho + S D^{-1} S)^{-1} S D^{-1}

(Woodbury). Patterson & Thompson 1971, doi:10.1093/biomet/58.3.545.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky, cholesky_banded, qr, solve_triangular

from qlvbayes.io.arrays import Array

_NONE = 1e-9  # of tau: readings nearer are one, to first order in their distance
_A_TIME = 6  # readings for each relaxation time of the trend: most of them are left for the noise


def regression(length: Array, count: Array, tau: float) -> Array:
    """Return the coefficient a (n,) of means of ``count`` readings over ``length``."""
    several, x = _steps(length, count, tau)
    return np.where(several, np.expm1(-x * count) / (count * np.expm1(-x)), 1.0)


def variance(length: Array, count: Array, tau: float) -> Array:
    """Return the variance v (n,) of the same means."""
    several, x = _steps(length, count, tau)
    loss = -np.expm1(-x)
    a = np.expm1(-x * count) / (count * -loss)
    return np.where(several, (2.0 - loss - 2.0 * (1.0 - loss) * a) / (count * loss), 1.0)


def _steps(length: Array, count: Array, tau: float) -> tuple[NDArray[np.bool_], Array]:
    """Return which means are over several instants, and their distance over tau (elsewhere 1)."""
    x = length / (np.maximum(count - 1.0, 1.0) * tau)
    several = (count > 1.0) & (x > _NONE)
    return several, np.where(several, x, 1.0)


@dataclass(frozen=True)
class Dwell:
    """A dwell: all readings (n,) and the first one (k,) of each run that is averaged."""

    time: Array
    force: Array
    scale: Array  # (n,) relative sd of each reading
    begin: NDArray[np.intp]
    degree: int = 1  # of the polynomial that is there with the relaxation
    curve: Array | None = None  # (k, p) means over the runs of what may be there instead

    @property
    def count(self) -> Array:
        """Readings in each run (k,)."""
        return np.diff(np.append(self.begin, self.time.size)).astype(np.float64)

    @property
    def length(self) -> Array:
        """Time (k,) from a run's first reading to its last."""
        last = np.append(self.begin[1:], self.time.size) - 1
        return np.asarray(self.time[last] - self.time[self.begin])

    def mean(self, values: Array) -> Array:
        """Return means over the runs (k, ...) of values (n, ...)."""
        total = np.add.reduceat(values, self.begin, axis=0)
        return np.asarray(total / self.count.reshape(-1, *[1] * (values.ndim - 1)))

    def trend(self, ratio: float) -> Array:
        """Return an orthonormal basis (k, p) of everything but the noise, over the run's sds.

        It spans a polynomial in time and exponentials, times of which are ``ratio`` apart.
        """
        curve = self.curve
        if curve is None:
            t = self.time - self.time[0]
            length = float(t[-1])
            shortest = max(2.0 * float(t[1]), 2e-4 * length)
            number = 1.0 + np.log(length / shortest) // np.log(ratio)
            times = length / ratio ** np.arange(number)
            if (most := max(2, self.begin.size // _A_TIME)) < times.size:
                times = np.geomspace(times[0], times[-1], most)
            powers = legendre.legvander(2.0 * t / length - 1.0, self.degree)
            curve = self.mean(np.column_stack([powers, np.exp(-t[:, None] / times)]))
        q, r, _ = qr(curve / self.run_scale[:, None], mode="economic", pivoting=True)
        size = np.abs(np.diag(r))
        return np.asarray(q[:, size > 1e-10 * size[0]], dtype=np.float64)

    @property
    def run_scale(self) -> Array:
        """Relative sd (k,) of a reading in each run, as a root mean square."""
        return np.sqrt(self.mean(self.scale**2))


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
    constant: float = 0.0  # of the log-likelihood, for relative sds

    @classmethod
    def from_dwells(cls, dwells: list[Dwell], ratio: float) -> Pool:
        """Return means over runs without trends; ``ratio`` of neighbouring relaxation times."""
        trends, left, smooth = [], [], []
        for dwell in dwells:
            q, scale = dwell.trend(ratio), dwell.run_scale
            value = dwell.mean(dwell.force)
            fitted = scale * (q @ (q.T @ (value / scale)))
            y = (value - fitted) / scale
            trends.append(q)
            smooth.append(fitted)
            left.append(y - q @ (q.T @ y))
        gaps = [np.append(np.diff(dwell.mean(dwell.time)), np.inf) for dwell in dwells]
        return cls(
            np.concatenate(gaps)[:-1],
            np.concatenate([dwell.count for dwell in dwells]),
            np.concatenate([dwell.length for dwell in dwells]),
            np.concatenate(smooth),
            np.concatenate(left),
            trends,
        )

    @property
    def freedom(self) -> int:
        """Number of runs minus that of the trends' columns."""
        return sum(q.shape[0] - q.shape[1] for q in self.trends)

    def scaled(self, scale: Array) -> Pool:
        """Return the same data for noise whose sd is proportional to ``scale`` (n,)."""
        trends, ys, constant = [], [], -float(np.log(scale).sum())
        for q, rows in self._parts():
            own, r = np.linalg.qr(q / scale[rows, None])
            constant -= float(np.log(np.abs(np.diag(r))).sum())
            y = self.y[rows] / scale[rows]
            trends.append(own)
            ys.append(y - own @ (own.T @ y))
        return replace(self, y=np.concatenate(ys), trends=trends, constant=constant)

    def _parts(self) -> list[tuple[Array, slice]]:
        """Return the trend of each dwell with its rows."""
        ends = np.cumsum([len(q) for q in self.trends]).tolist()
        return [(q, slice(end - len(q), end)) for q, end in zip(self.trends, ends, strict=True)]

    @cached_property
    def _columns(self) -> Array:
        """Data and trends (n, 1 + p) side by side."""
        width = max(q.shape[1] for q in self.trends)
        padded = [np.pad(q, ((0, 0), (0, width - q.shape[1]))) for q in self.trends]
        return np.column_stack([self.y, np.concatenate(padded)])

    @cached_property
    def of_white(self) -> tuple[float, float]:
        """Log-likelihood and variance of white noise alone."""
        return self._restricted(self.count[:, None] * self._columns, -np.log(self.count).sum())

    def likelihood(self, log_ratio: float, log_tau: float) -> tuple[float, float]:
        """Return the restricted log-likelihood (up to a constant) and the best white variance."""
        ratio, tau = np.exp(log_ratio), np.exp(log_tau)
        shrink = np.sqrt(variance(self.length, self.count, float(tau)))
        band, log_precision = _precision(self.gaps / tau)
        band = band / ratio
        log_precision -= self.y.size * log_ratio
        band[-1] += shrink**2 * self.count
        factor = cholesky_banded(band, check_finite=False)
        weighted = (shrink * self.count)[:, None] * self._columns
        inner = cho_solve_banded((factor, False), weighted, check_finite=False)
        solved = self.count[:, None] * (self._columns - shrink[:, None] * inner)
        log_det = 2.0 * float(np.log(factor[-1]).sum()) - log_precision
        return self._restricted(solved, log_det - float(np.log(self.count).sum()))

    def _restricted(self, solved: Array, log_det: float) -> tuple[float, float]:
        """Return the restricted likelihood from V^-1 (y, trends) and log det V."""
        power, freedom = float(self.y @ solved[:, 0]), self.freedom
        for q, rows in self._parts():
            gram = cholesky(q.T @ solved[rows, 1 : q.shape[1] + 1], lower=True, check_finite=False)
            moment = solve_triangular(gram, q.T @ solved[rows, 0], lower=True, check_finite=False)
            power -= float(moment @ moment)
            log_det += 2.0 * float(np.log(np.diag(gram)).sum())
        white = max(power, float(np.finfo(np.float64).tiny)) / freedom
        return self.constant - 0.5 * (freedom * np.log(white) + log_det), white


def _precision(x: Array) -> tuple[Array, float]:
    """Return the upper band (2, n) of an OU process's precision, and its log det.

    Between nearer readings than _NONE the digits of the precision would not suffice.
    """
    x = np.maximum(x, _NONE)
    a, left = np.exp(-x), -np.expm1(-2.0 * x)
    band = np.zeros((2, x.size + 1))
    band[1] = 1.0
    band[1, 1:] += a**2 / left
    band[1, :-1] += a**2 / left
    band[0, 1:] = -a / left
    return band, -float(np.log(left).sum())
