"""Where sampling starts: least squares for the model, the measured floor for the noise."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from qlvbayes.fitting.least_squares import least_squares, normal_approximation, without_noise
from qlvbayes.fitting.normal import NormalApproximation
from qlvbayes.fitting.optimum import Optimum, find_optimum
from qlvbayes.model.posterior import Posterior, central
from qlvbayes.preprocess.noisefloor import NoiseFloor

_NOISE_SD = 0.3  # of the noise's unconstrained numbers, to begin with
_OPTIMA = 2  # distinct least-squares optima that are climbed from


def block_scale(posterior: Posterior, floor: NoiseFloor) -> np.ndarray:
    """(T, B) sd of each block mean under the noise floor, as if blocks were independent."""
    blocks = posterior.record.blocks
    variance = floor.white**2 / np.asarray(blocks.count) + floor.ou**2
    own = np.asarray(blocks.weight) * np.asarray(blocks.scale) * np.sqrt(variance)
    return np.hypot(own, np.asarray(blocks.extra))


def starting_point(posterior: Posterior, floor: NoiseFloor, rng: np.random.Generator) -> Optimum:
    """Highest point found from multi-start least squares, and the curvature there."""
    bare = without_noise(posterior)
    scale = block_scale(posterior, floor)
    fits = least_squares(bare, scale, rng)
    noise = central(posterior.noise)
    guesses = []
    for theta in fits.thetas[:_OPTIMA]:
        normal, _ = normal_approximation(bare, scale, theta)
        spread = block_diag(normal.covariance, _NOISE_SD**2 * np.eye(noise.size))
        guesses.append(NormalApproximation(np.concatenate([theta, noise]), spread))
    return find_optimum(posterior, guesses)
