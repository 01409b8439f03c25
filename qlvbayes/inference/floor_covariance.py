"""The covariance of block means that the noise floor alone gives."""

from __future__ import annotations

import numpy as np

from qlvbayes.model.record import Blocks
from qlvbayes.preprocess.noisefloor import NoiseFloor
from qlvbayes.preprocess.noisefloor.averages import rate, regression, variance

_LEAST = 1e-6  # sd of a block mean, over the largest force, that keeps covariances invertible


def covariance(floor: NoiseFloor, blocks: Blocks, peak: float) -> np.ndarray:
    """Covariance (N, N) of the noise of one test's block means (N^2); peak: largest force (N).

    A millionth of it every block mean has, whatever the floor. What the motion is not known by is
    one error a block, and alike over a movement.
    """
    first, last, count, weight, scale, extra = map(
        np.asarray,
        (blocks.first, blocks.last, blocks.count, blocks.weight, blocks.scale, blocks.extra),
    )
    white = (floor.white * weight * scale) ** 2 / count + (_LEAST * peak) ** 2
    correlated = floor.ou**2 * np.outer(scale, scale)
    correlation = averaged_correlation(first, last, count, floor.tau, floor.smooth)
    moving = (extra > 0.0).astype(float)
    group = np.cumsum(np.abs(np.diff(moving, prepend=moving[:1])))
    alike = np.where(group[:, None] == group, 0.5, 0.0)
    motion = np.outer(extra, extra) * (alike + 0.5 * np.eye(extra.size))
    return np.diag(white) + correlated * correlation + motion


def averaged_correlation(
    first: np.ndarray, last: np.ndarray, count: np.ndarray, tau: float, smooth: bool = False
) -> np.ndarray:
    """Correlation (N, N) of means over ``count`` evenly spaced readings of a unit process."""
    z = rate(tau, smooth)
    mean = regression(last - first, count, z)
    gap = np.maximum(first[None, :] - last[:, None], 0.0)
    found = np.exp(-z * (gap + gap.T)) * np.outer(mean, mean)
    np.fill_diagonal(found, variance(last - first, count, z))
    return np.real(z * tau * found)
