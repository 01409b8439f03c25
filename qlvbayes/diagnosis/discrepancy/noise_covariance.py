"""The covariance of block means that the noise floor alone gives."""

from __future__ import annotations

import numpy as np

from qlvbayes.experiment import Experiment
from qlvbayes.records.record import Blocks

_LEAST_NOISE = 1e-6  # sd, over the largest force, that keeps the covariance invertible


def floor_covariance(experiment: Experiment, blocks: Blocks) -> np.ndarray:
    """Covariance (N, N) of the noise floor of one test's block means (N^2)."""
    floor = experiment.floor
    first, last, count, weight = map(
        np.asarray, (blocks.first, blocks.last, blocks.count, blocks.weight)
    )
    white = (floor.white * weight) ** 2 / count + (_LEAST_NOISE * experiment.scales.force) ** 2
    return np.diag(white) + floor.ou**2 * averaged_correlation(first, last, floor.tau)


def averaged_correlation(first: np.ndarray, last: np.ndarray, tau: float) -> np.ndarray:
    r"""Correlation (N, N) of averages over stretches of an Ornstein-Uhlenbeck process.

    Of lengths x, y in units of tau and a gap d between them: e^{-d} f(x) f(y), f(x) =
    (1 - e^{-x})/x; of a stretch with itself: 2 (x - 1 + e^{-x})/x^2.
    """
    length = np.maximum((last - first) / tau, 1e-6)
    mean = -np.expm1(-length) / length
    gap = np.maximum(first[None, :] - last[:, None], 0.0) / tau
    far = np.exp(-np.maximum(gap, gap.T)) * np.outer(mean, mean)
    own = np.where(
        length < 1e-3, 1.0 - length / 3.0, 2.0 * (length + np.expm1(-length)) / length**2
    )
    np.fill_diagonal(far, own)
    return far
