"""The posterior's highest point, where sampling starts, and the curvature there (Laplace's).

Optimised from least squares for the model and from the priors' middle for the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize

from qlvbayes.fitting import compiled
from qlvbayes.fitting.least_squares import (
    LARGEST_SD,
    NormalApproximation,
    least_squares,
    normal_approximation,
    without_noise,
)
from qlvbayes.model.posterior import Posterior, central
from qlvbayes.motion.noisefloor import NoiseFloor

_PASSES = 3
_NOISE_SD = 0.3  # of the noise's unconstrained numbers, to begin with
_OPTIMA = 2  # distinct least-squares optima that are optimised from


@dataclass(frozen=True)
class Optimum:
    """theta (D,) of highest density, log density there, and the normal approximation."""

    theta: np.ndarray
    log_density: float
    normal: NormalApproximation


def block_scale(posterior: Posterior, floor: NoiseFloor) -> np.ndarray:
    """(T, B) sd of each block mean under the noise floor, as if blocks were independent."""
    blocks = posterior.record.blocks
    variance = floor.white**2 / np.asarray(blocks.count) + floor.ou**2
    own = np.asarray(blocks.weight) * np.asarray(blocks.scale) * np.sqrt(variance)
    return np.hypot(own, np.asarray(blocks.extra))


def starting_point(posterior: Posterior, floor: NoiseFloor, rng: np.random.Generator) -> Optimum:
    """Highest point found from multi-start least squares, and the curvature there."""
    return optimum_near(posterior, floor, least_squares_points(posterior, floor, rng))


def least_squares_points(
    posterior: Posterior, floor: NoiseFloor, rng: np.random.Generator
) -> list[np.ndarray]:
    """Thetas of the model alone at the best optima of multi-start least squares."""
    fits = least_squares(without_noise(posterior), block_scale(posterior, floor), rng)
    return list(fits.thetas[:_OPTIMA])


def optimum_near(posterior: Posterior, floor: NoiseFloor, thetas: Sequence[np.ndarray]) -> Optimum:
    """The highest point found from some thetas of the model alone."""
    bare, scale = without_noise(posterior), block_scale(posterior, floor)
    noise = central(posterior.noise)
    guesses = []
    for theta in thetas:
        normal, _ = normal_approximation(bare, scale, theta)
        spread = block_diag(normal.covariance, _NOISE_SD**2 * np.eye(noise.size))
        guesses.append(NormalApproximation(np.concatenate([theta, noise]), spread))
    return find_optimum(posterior, guesses)


def find_optimum(posterior: Posterior, guesses: list[NormalApproximation]) -> Optimum:
    """Optimise from each guess (quasi-Newton, exact gradients) and keep the highest point.

    A guess's covariance only sets the scale of the steps; it need not be accurate.
    """
    optima = [(_optimised(posterior, guess), guess) for guess in guesses]
    (theta, loss), guess = min(optima, key=lambda found: found[0][1])
    covariance = _covariance(posterior, theta, np.linalg.cholesky(guess.covariance))
    return Optimum(theta, -loss, NormalApproximation(theta, covariance))


def _optimised(posterior: Posterior, guess: NormalApproximation) -> tuple[np.ndarray, float]:
    axes = np.linalg.cholesky(guess.covariance)

    def loss(z: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = compiled.loss_and_gradient(posterior, guess.mean + axes @ z)
        if not np.isfinite(value):
            return 1e100, np.zeros_like(z)
        return float(value), axes.T @ np.asarray(gradient)

    options = {"maxiter": 500, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-4}
    result = minimize(loss, np.zeros_like(guess.mean), jac=True, method="L-BFGS-B", options=options)
    return guess.mean + axes @ result.x, float(result.fun)


def _covariance(posterior: Posterior, theta: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Inverse curvature (D, D) of minus log density at the scale of the posterior itself.

    Differences of exact gradients half an sd either side of the optimum, along directions (the
    columns of ``axes``, about one sd long) that each pass whitens anew. Contact makes the gradient
    jump where a force reaches zero, so that the curvature at a point would describe one side of a
    kink; and this spares compiling second derivatives. Where the density does not curve down, the
    sd is bounded.
    """
    for _ in range(_PASSES):
        change = np.array([_gradient_change(posterior, theta, 0.5 * axis) for axis in axes.T])
        values, vectors = np.linalg.eigh(0.5 * (change @ axes + axes.T @ change.T))
        directions = axes @ vectors
        flattest = np.sum(directions**2, axis=0) / LARGEST_SD**2
        axes = directions / np.sqrt(np.maximum(values, flattest))
    return axes @ axes.T


def _gradient_change(posterior: Posterior, theta: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Change of the gradient over twice ``half``, which is one axis long."""
    above = compiled.loss_and_gradient(posterior, theta + half)[1]
    below = compiled.loss_and_gradient(posterior, theta - half)[1]
    return np.asarray(above) - np.asarray(below)
