"""Fit a model by least squares from many starts.

The paper's routes use it, and the sampler starts from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult
from scipy.optimize import least_squares as minimise

from qlvbayes.fitting import compiled
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.model.noise import White
from qlvbayes.model.posterior import Posterior, draw_priors

LARGEST_SD = 3.0  # of a direction that the data do not determine, in theta's units of order one
_PRIOR_DRAWS = 96
_BOUND_SDS = 5.0
_LINEAR = 4.0  # times the predicted rise of the sum of squares that a draw may have
_HALVINGS = 12  # of a draw's step: to 1/4000 of a prior's width


@dataclass(frozen=True)
class NormalApproximation:
    """A normal distribution over theta: mean (D,) and covariance (D, D)."""

    mean: np.ndarray
    covariance: np.ndarray

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Return draws (count, D)."""
        root = np.linalg.cholesky(self.covariance)
        return self.mean + rng.standard_normal((count, self.mean.size)) @ root.T


@dataclass(frozen=True)
class LeastSquares:
    """The optima of several starts, best first: thetas (D,) with their sums of squares."""

    thetas: tuple[np.ndarray, ...]
    costs: tuple[float, ...]


def without_noise(posterior: Posterior) -> Posterior:
    """Return the posterior with the same constants and record, but with fixed noise."""
    return Posterior(posterior.model, White(1.0), posterior.record)


def least_squares(
    posterior: Posterior, scale: np.ndarray, rng: np.random.Generator, starts: int = 8
) -> LeastSquares:
    """Minimise the sum of ((block mean - model)/scale)^2 over the model's free constants."""
    # the optimiser's tolerance on gradients is absolute
    scale = scale * float(np.max(np.abs(np.asarray(posterior.record.blocks.force))))
    draws = draw_priors(posterior, _PRIOR_DRAWS, rng)
    centre, distance = draws.mean(axis=0), _BOUND_SDS * draws.std(axis=0)
    low, high = centre - distance, centre + distance
    draws = np.clip(draws, low, high)
    with np.errstate(over="ignore"):  # a sum that overflows is the worst
        sums = np.array([np.sum(_residuals(posterior, scale, draw)[0] ** 2) for draw in draws])
        order = [k for k in np.argsort(sums) if np.isfinite(sums[k])]
        optima = [_descend(posterior, scale, draws[k], (low, high)) for k in order[:starts]]
    if not optima:
        raise NoFiniteForceError
    optima.sort(key=lambda result: result.cost)
    return LeastSquares(tuple(r.x for r in optima), tuple(2.0 * float(r.cost) for r in optima))


def _descend(
    posterior: Posterior,
    scale: np.ndarray,
    start: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
) -> OptimizeResult:
    """Return the optimum that a start leads to."""
    inside = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)
    slopes_at: dict[bytes, np.ndarray] = {}

    def residuals(theta: np.ndarray) -> np.ndarray:
        # the derivatives come with the residuals, and the optimiser asks for them next
        slopes_at.clear()
        values, slopes_at[theta.tobytes()] = _residuals(posterior, scale, theta)
        return values

    def slopes(theta: np.ndarray) -> np.ndarray:
        if theta.tobytes() not in slopes_at:
            residuals(theta)
        return slopes_at[theta.tobytes()]

    return minimise(residuals, inside, jac=slopes, bounds=bounds, x_scale="jac", max_nfev=200)


def _residuals(
    posterior: Posterior, scale: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals (T*B,) over ``scale`` and their derivatives (T*B, D)."""
    values, slopes = compiled.residuals_and_slopes(posterior, scale, theta)
    return np.asarray(values), np.asarray(slopes)


def normal_approximation(
    posterior: Posterior, scale: np.ndarray, theta: np.ndarray
) -> tuple[NormalApproximation, float]:
    """Return the covariance s^2 (J^T J)^-1 about an optimum, and s in units of ``scale``."""
    values, slopes = _residuals(posterior, scale, theta)
    cost = float(np.sum(values**2))
    points = int(np.sum(np.asarray(posterior.record.blocks.real) & np.isfinite(scale)))
    variance = cost / max(points - theta.size, 1)
    curvature = slopes.T @ slopes / max(variance, 1e-300)
    return NormalApproximation(theta, covariance_from(curvature)), float(np.sqrt(variance))


def fitting_draws(
    posterior: Posterior,
    scale: np.ndarray,
    normal: NormalApproximation,
    count: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return draws (count, D) that fit about as well as the normal approximation says."""
    draws = normal.draw(count, rng)
    values, slopes = _residuals(posterior, scale, normal.mean)
    cost = float(values @ values)
    fitted = int(np.sum(np.asarray(posterior.record.blocks.real) & np.isfinite(scale)))
    slack = cost * normal.mean.size / max(fitted - normal.mean.size, 1)

    def rises(thetas: np.ndarray) -> np.ndarray:
        return compiled.in_batches(
            lambda known, some: compiled.sums_of_squares(known, scale, some), posterior, thetas
        )

    for _ in range(_HALVINGS):
        expected = np.sum(((draws - normal.mean) @ slopes.T) ** 2, axis=1)
        far = ~(rises(draws) <= cost + slack + _LINEAR * expected)
        if not far.any():
            break
        draws[far] = 0.5 * (draws[far] + normal.mean)
    return draws


def covariance_from(curvature: np.ndarray) -> np.ndarray:
    """Return the inverse of a curvature (D, D), with sds of ``LARGEST_SD`` at most."""
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    limited = np.maximum(values, 1.0 / LARGEST_SD**2)
    return (vectors / limited) @ vectors.T
