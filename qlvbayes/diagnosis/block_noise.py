"""The covariance of block means that the noise floor alone gives."""

from __future__ import annotations

import numpy as np

from qlvbayes.experiment import Experiment
from qlvbayes.noisefloor import NoiseFloor
from qlvbayes.records.record import Blocks

LEAST_NOISE = 1e-6  # sd of a block mean, over the largest force, that keeps covariances invertible


def floor_covariance(experiment: Experiment, blocks: Blocks) -> np.ndarray:
    """Covariance (N, N) of the noise floor of one test's block means (N^2)."""
    return covariance(experiment.floor, blocks, LEAST_NOISE * experiment.scales.force)


def covariance(floor: NoiseFloor, blocks: Blocks, least: float) -> np.ndarray:
    """The same of any floor; ``least``: sd (N) of the white noise that every block mean has.

    What the motion is not known by is one error a block, and alike over a movement.
    """
    first, last, count, weight, scale, extra = map(
        np.asarray,
        (blocks.first, blocks.last, blocks.count, blocks.weight, blocks.scale, blocks.extra),
    )
    white = (floor.white * weight * scale) ** 2 / count + least**2
    correlated = floor.ou**2 * np.outer(scale, scale)
    correlation = _smooth_correlation if floor.smooth else averaged_correlation
    moving = (extra > 0.0).astype(float)
    group = np.cumsum(np.abs(np.diff(moving, prepend=moving[:1])))
    alike = np.where(group[:, None] == group, 0.5, 0.0)
    motion = np.outer(extra, extra) * (alike + 0.5 * np.eye(extra.size))
    return np.diag(white) + correlated * correlation(first, last, floor.tau) + motion


def averaged_correlation(first: np.ndarray, last: np.ndarray, tau: complex) -> np.ndarray:
    r"""Correlation (N, N) of averages over stretches of an Ornstein-Uhlenbeck process.

    Of lengths x, y in units of tau and a gap d between them: e^{-d} f(x) f(y), f(x) =
    (1 - e^{-x})/x; of a stretch with itself: 2 (x - 1 + e^{-x})/x^2.
    """
    length = np.maximum(last - first, 1e-6 * abs(tau)) / tau
    mean = -np.expm1(-length) / length
    gap = np.maximum(first[None, :] - last[:, None], 0.0) / tau
    far = np.exp(-(gap + gap.T)) * np.outer(mean, mean)
    own = np.where(
        np.abs(length) < 1e-3,
        1.0 - length / 3.0,
        2.0 * (length + np.expm1(-length)) / length**2,
    )
    np.fill_diagonal(far, own)
    return far


def _smooth_correlation(first: np.ndarray, last: np.ndarray, tau: float) -> np.ndarray:
    """The same of the process of correlation e^-x (cos x + sin x) = Re (1 - i) e^-(1 - i)x."""
    factor = 1.0 - 1.0j
    return np.real(factor * averaged_correlation(first, last, tau / factor))
