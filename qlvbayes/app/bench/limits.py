"""Compute the error that noise alone makes in a cell of test and phase."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.fitting.residuals import FALSE_ALARMS
from qlvbayes.io.arrays import Array
from qlvbayes.motion.phases import KINDS

_LEAST_SKEW = 1e-3  # skewness of a mean square below which it is taken for normal


def cell_limits(samples: Samples) -> dict[tuple[str, str], float]:
    """Return the root mean square, by test and phase, that noise exceeds in 1 % of pads."""
    floor = samples.experiment.floor
    cells = {}
    for k, trial in enumerate(samples.trials):
        time, phases = trial.test.time[samples.rows[k]], samples.phases(k)
        white = floor.white * samples.weights[k]
        for kind in KINDS:
            here = phases == kind
            if here.any():
                gaps = np.abs(time[here][:, None] - time[here])
                covariance = floor.ou**2 * np.exp(-gaps / floor.tau)
                cells[trial.name, kind] = covariance + np.diag(white[here] ** 2)
    level = FALSE_ALARMS / max(len(cells), 1)
    return {cell: _limit(covariance, level) for cell, covariance in cells.items()}


def _limit(covariance: Array, level: float) -> float:
    """Return the root of the upper quantile of the mean square of a normal of this covariance.

    The mean square is approximated by a chi-square with the same mean, variance and skewness
    (Pearson; Imhof 1961, doi:10.1093/biomet/48.3-4.419).
    """
    scaled = covariance / len(covariance)
    twice = scaled @ scaled
    mean, variance = float(np.trace(scaled)), 2.0 * float(np.sum(scaled**2))
    third = 8.0 * float(np.sum(twice * scaled))
    if variance <= 0.0:
        return float(np.sqrt(mean))
    freedom = 8.0 * variance**3 / max(third, _LEAST_SKEW * variance**1.5) ** 2
    deviate = (float(chi2.isf(level, freedom)) - freedom) / np.sqrt(2.0 * freedom)
    return float(np.sqrt(max(mean + np.sqrt(variance) * deviate, 0.0)))
