"""The posterior's highest point and the curvature there (Laplace's approximation)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from qlvbayes.fitting import compiled
from qlvbayes.fitting.normal import LARGEST_SD, NormalApproximation
from qlvbayes.model.posterior import Posterior

_PASSES = 3


@dataclass(frozen=True)
class Optimum:
    """theta (D,) of highest density, log density there, and the normal approximation."""

    theta: np.ndarray
    log_density: float
    normal: NormalApproximation


def find_optimum(posterior: Posterior, guesses: list[NormalApproximation]) -> Optimum:
    """Climb from each guess (quasi-Newton, exact gradients) and keep the highest point.

    A guess's covariance only sets the scale of the steps; it need not be accurate.
    """
    climbs = [(_climb(posterior, guess), guess) for guess in guesses]
    (theta, loss), guess = min(climbs, key=lambda found: found[0][1])
    covariance = _covariance(posterior, theta, np.linalg.cholesky(guess.covariance))
    return Optimum(theta, -loss, NormalApproximation(theta, covariance))


def _climb(posterior: Posterior, guess: NormalApproximation) -> tuple[np.ndarray, float]:
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
