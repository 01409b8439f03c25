r"""The remainder: the size of the structure that a model leaves, cell by cell, in newtons.

The adequacy test says whether structure is certain, not whether it matters. In a cell of n samples
with residual r and the noise at rest, covariance Sigma, the smooth curves B (rows: Legendre
polynomials of order 0 to 3) are fitted by generalised least squares,

.. math:: \hat\beta = C B \Sigma^{-1} r, \quad C = (B \Sigma^{-1} B^T)^{-1}, \quad
          Q = \hat\beta^T M \hat\beta, \quad M = B B^T / n

Q is the mean square of the fitted curve; in combinations of curves whose noise is independent and
of unit variance it is a sum of mu_k z_k^2 (mu the eigenvalues of MC), of which noise alone would
make mu_k each. The structured part has the mean square

.. math:: s^2 = \max\left(\sum_k \mu_k (z_k^2 - 1), 0\right)

For its upper bound, combinations that stand out (abs(z) above 1.96) are taken to be 1.645 sds
larger. The others count by what they hold beyond noise, as nothing certain is there to be bounded:

.. math:: s_u^2 = \sum_k \mu_k u_k^2, \quad u_k = |z_k| + 1.645 \text{ or }
          u_k^2 = \max(z_k^2 - 1, 0)

The remainder is small if this bound is below the tolerance, a share of the peak force, in every
cell that stands out (p of the adequacy test below 5 %), and if the error over all samples exceeds
the noise by less than the tolerance. The latter sees what no smooth curve shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtri

from qlvbayes.diagnosis.checks.adequacy import Adequacy
from qlvbayes.diagnosis.checks.samples import Samples, rmse
from qlvbayes.diagnosis.result import RemainingStructure
from qlvbayes.diagnosis.settings import DiagnosisSettings

_RIDGE = (
    1e-9  # of the variance, so that the covariance of noise without a white part can be factorised
)


@dataclass(frozen=True)
class StructuredPart:
    """The structured part of the residual in one cell."""

    test: str
    phase: str
    start: float  # begin of the phase (s)
    n: int
    # rms, upper: root mean square (N), and its upper bound at 95 %
    rms: float
    upper: float
    bias: float  # mean of the fitted curve (N)
    shown: bool  # whether the cell stands out in the adequacy test


@dataclass(frozen=True)
class Remainder:
    """The structure that a model leaves, and the size below which it does not matter."""

    cells: tuple[StructuredPart, ...]
    peak: float  # largest force (N)
    # by how much the error of all samples exceeds the noise, (rmse^2 - noise^2)^1/2 (N)
    excess: float
    tolerance: float  # share of the largest force below which structure does not matter
    before: float  # structured part over all cells that the baseline model leaves (N)
    sure: bool = False  # whether the adequacy test sees structure at all

    @property
    def worst(self) -> StructuredPart | None:
        """The largest cell, among those that stand out if there are any; None without cells."""
        return max(self._shown or self.cells, key=lambda cell: cell.rms, default=None)

    @property
    def is_small(self) -> bool:
        """True if all of it is certainly below the tolerance."""
        limit = self.tolerance * self.peak
        largest = max((cell.upper for cell in self._shown), default=0.0)
        return limit > 0.0 and max(largest, self.excess) <= limit

    @property
    def share_of_error(self) -> float | None:
        """The structured part over that of the baseline model; None where that leaves none."""
        return overall(self.cells) / self.before if self.before > 0.0 else None

    @property
    def _shown(self) -> tuple[StructuredPart, ...]:
        return tuple(cell for cell in self.cells if cell.shown)

    @property
    def record(self) -> RemainingStructure | None:
        """The record for ``diagnosis.json``, of the largest cell; None without cells."""
        worst = self.worst
        if worst is None:
            return None
        return RemainingStructure(
            rms=worst.rms,
            upper95=worst.upper,
            share_of_peak=worst.rms / self.peak,
            share_of_error=self.share_of_error,
            test=worst.test,
            phase=worst.phase,
            bias=worst.bias,
            excess=self.excess,
            sure=self.sure,
            small=self.is_small,
        )


def remainder(
    samples: Samples,
    residuals: Sequence[np.ndarray],
    tested: Adequacy,
    baseline: Sequence[np.ndarray],
    *,
    peak: float,
    settings: DiagnosisSettings,
) -> Remainder:
    """Return the size of the structure in residuals, measured minus predicted force (N)."""
    cells = tuple(_cells(samples, residuals, tested, settings))
    error, noise = rmse(list(residuals)), _noise(samples)
    excess = float(np.sqrt(max(error**2 - noise**2, 0.0)))
    before = overall(tuple(_cells(samples, baseline, tested, settings)))
    sure = not tested.is_sound(settings)
    return Remainder(cells, peak, excess, settings.tolerance, before, sure)


def overall(cells: Sequence[StructuredPart]) -> float:
    """Return the root mean square of the structured part over the samples of all cells (N)."""
    count = sum(cell.n for cell in cells)
    return float(np.sqrt(sum(c.n * c.rms**2 for c in cells) / count)) if count else 0.0


def _noise(samples: Samples) -> float:
    """Return the root mean square of the noise of all samples (N)."""
    floors = np.concatenate([samples.floor(k) for k in range(len(samples.trials))])
    return float(np.sqrt(np.mean(floors**2)))


def _cells(
    samples: Samples, residuals: Sequence[np.ndarray], tested: Adequacy, settings: DiagnosisSettings
) -> Iterator[StructuredPart]:
    """Yield the structured part of residuals (N) in each phase of each test."""
    shown = {(c.test, c.phase, c.start): c.p_value < settings.cells.level for c in tested.cells}
    for k, trial in enumerate(samples.trials):
        time, weights = trial.test.time[samples.rows[k]], samples.weights[k]
        for phase in trial.phases:
            here = (time > phase.start) & (time <= phase.stop)
            count = min(settings.cells.curves, int(here.sum()) // settings.cells.blocks)
            if not count:
                continue
            cell = (trial.name, phase.kind, phase.start)
            noise = _covariance(samples, time[here], weights[here])
            size = structured(residuals[k][here], noise, count, settings.cells.level)
            yield StructuredPart(*cell, int(here.sum()), *size, shown.get(cell, False))


def _covariance(samples: Samples, time: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the covariance (n, n) of white and correlated noise at rest (N^2)."""
    floor = samples.experiment.floor
    white, ou, tau = floor.white, floor.ou, floor.tau
    apart = np.abs(time[:, None] - time) / tau
    variance = (white * weights) ** 2 + _RIDGE * (white**2 + ou**2)
    return ou**2 * np.exp(-apart) + np.diag(variance)


def structured(
    residual: np.ndarray, covariance: np.ndarray, orders: int, level: float
) -> tuple[float, float, float]:
    """Return root mean square, upper bound and mean of a residual's structured part (N)."""
    positions = np.linspace(-1.0, 1.0, residual.size)
    curves = legendre.legvander(positions, orders - 1).T
    weighted = cho_solve(cho_factor(covariance), curves.T).T
    root = np.linalg.inv(np.linalg.cholesky(weighted @ curves.T)).T
    means, turned = np.linalg.eigh(root.T @ (curves @ curves.T) @ root / residual.size)
    z = turned.T @ root.T @ weighted @ residual
    beyond = means * (z**2 - 1.0)
    far, more = ndtri(1.0 - 0.5 * level), ndtri(1.0 - level)
    bound = np.where(np.abs(z) > far, means * (np.abs(z) + more) ** 2, beyond)
    rms, upper = (np.sqrt(max(np.sum(x), 0.0)) for x in (beyond, np.maximum(bound, 0.0)))
    return float(rms), float(upper), float(np.mean((root @ turned @ z) @ curves))
