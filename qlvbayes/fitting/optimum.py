"""Find the mode of the posterior, from which sampling starts, and the curvature there (Laplace).

The optimisation starts from least squares for the model and from the centre of the prior for the
noise.
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
_NOISE_SD = 0.3  # of the noise's unconstrained parameters, as a first guess
_OPTIMA = 2  # distinct least-squares optima from which the posterior is optimised


@dataclass(frozen=True)
class Optimum:
    """The mode theta (D,), the log density there, and the normal approximation."""

    theta: np.ndarray
    log_density: float
    normal: NormalApproximation


def block_scale(posterior: Posterior, floor: NoiseFloor) -> np.ndarray:
    """Return the sd (T, B) of each block mean under the noise floor, ignoring correlations."""
    blocks = posterior.record.blocks
    variance = floor.white**2 / np.asarray(blocks.count) + floor.ou**2
    readings = np.asarray(blocks.weight) * np.asarray(blocks.scale) * np.sqrt(variance)
    return np.hypot(readings, np.asarray(blocks.extra))


def starting_point(posterior: Posterior, floor: NoiseFloor, rng: np.random.Generator) -> Optimum:
    """Return the mode found from multi-start least squares."""
    return optimum_near(posterior, floor, least_squares_points(posterior, floor, rng))


def least_squares_points(
    posterior: Posterior, floor: NoiseFloor, rng: np.random.Generator
) -> list[np.ndarray]:
    """Return thetas of the model alone at the best optima of multi-start least squares."""
    fits = least_squares(without_noise(posterior), block_scale(posterior, floor), rng)
    return list(fits.thetas[:_OPTIMA])


def optimum_near(posterior: Posterior, floor: NoiseFloor, thetas: Sequence[np.ndarray]) -> Optimum:
    """Return the mode found from thetas (D,) of the model alone."""
    bare, scale = without_noise(posterior), block_scale(posterior, floor)
    noise = central(posterior.noise)
    guesses = []
    for theta in thetas:
        normal, _ = normal_approximation(bare, scale, theta)
        spread = block_diag(normal.covariance, _NOISE_SD**2 * np.eye(noise.size))
        guesses.append(NormalApproximation(np.concatenate([theta, noise]), spread))
    return find_optimum(posterior, guesses)


def find_optimum(posterior: Posterior, guesses: list[NormalApproximation]) -> Optimum:
    """Return the highest of the modes found from each guess (quasi-Newton with exact gradients)."""
    optima = [(_optimised(posterior, guess), guess) for guess in guesses]
    (theta, loss), guess = min(optima, key=lambda optimum: optimum[0][1])
    covariance = _covariance(posterior, theta, np.linalg.cholesky(guess.covariance))
    return Optimum(theta, -loss, NormalApproximation(theta, covariance))


def _optimised(posterior: Posterior, guess: NormalApproximation) -> tuple[np.ndarray, float]:
    """Return the mode that a guess leads to, and minus the log density there."""
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
    """Return the inverse curvature (D, D) of minus the log density, at the posterior's scale."""
    for _ in range(_PASSES):
        change = np.array([_gradient_change(posterior, theta, 0.5 * axis) for axis in axes.T])
        values, vectors = np.linalg.eigh(0.5 * (change @ axes + axes.T @ change.T))
        directions = axes @ vectors
        flattest = np.sum(directions**2, axis=0) / LARGEST_SD**2
        axes = directions / np.sqrt(np.maximum(values, flattest))
    return axes @ axes.T


def _gradient_change(posterior: Posterior, theta: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the change (D,) of the gradient between ``half`` an axis before and after theta."""
    above = compiled.loss_and_gradient(posterior, theta + half)[1]
    below = compiled.loss_and_gradient(posterior, theta - half)[1]
    return np.asarray(above) - np.asarray(below)
