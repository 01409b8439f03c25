"""Least squares from many starts: the paper's own routes, and the sampler's starting point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult
from scipy.optimize import least_squares as minimise

from qlvbayes.fitting import compiled
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.model.noise import White
from qlvbayes.model.posterior import Posterior, draw_priors

LARGEST_SD = 3.0  # of a direction that the data leave open; theta's units are of order one
_PRIOR_DRAWS = 96
_BOUND_SDS = 5.0


@dataclass(frozen=True)
class NormalApproximation:
    """Mean (D,) and covariance (D, D) over theta."""

    mean: np.ndarray
    covariance: np.ndarray

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, D) draws."""
        root = np.linalg.cholesky(self.covariance)
        return self.mean + rng.standard_normal((count, self.mean.size)) @ root.T


@dataclass(frozen=True)
class LeastSquares:
    """Optima of several starts, best first, each a theta (D,) with its sum of squares.

    The sums are over the largest measured force squared.
    """

    thetas: tuple[np.ndarray, ...]
    costs: tuple[float, ...]


def without_noise(posterior: Posterior) -> Posterior:
    """The same constants and record; the noise is fixed, as least squares needs it."""
    return Posterior(posterior.model, White(1.0), posterior.record)


def least_squares(
    posterior: Posterior, scale: np.ndarray, rng: np.random.Generator, starts: int = 8
) -> LeastSquares:
    """Minimise the sum of ((block mean - model)/scale)^2 over the model's free constants.

    ``scale`` (T, B): what a residual is divided by. Starts are the best of 96 prior draws; bounds
    are five prior sds about the prior mean of the unconstrained numbers. The noise of
    ``posterior`` must be fixed. Raises NoFiniteForceError where no draw gives finite forces.
    """
    # the optimiser's tolerance on slopes is absolute
    scale = scale * float(np.max(np.abs(np.asarray(posterior.record.blocks.force))))
    draws = draw_priors(posterior, _PRIOR_DRAWS, rng)
    centre, reach = draws.mean(axis=0), _BOUND_SDS * draws.std(axis=0)
    low, high = centre - reach, centre + reach
    draws = np.clip(draws, low, high)
    with np.errstate(over="ignore"):  # a sum too large for a number is the worst
        sums = np.array([np.sum(_residuals(posterior, scale, draw)[0] ** 2) for draw in draws])
        order = [k for k in np.argsort(sums) if np.isfinite(sums[k])]
        found = [_descend(posterior, scale, draws[k], (low, high)) for k in order[:starts]]
    if not found:
        raise NoFiniteForceError
    found.sort(key=lambda result: result.cost)
    return LeastSquares(tuple(r.x for r in found), tuple(2.0 * float(r.cost) for r in found))


def _descend(
    posterior: Posterior,
    scale: np.ndarray,
    start: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
) -> OptimizeResult:
    inside = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)
    latest: dict[bytes, np.ndarray] = {}

    def residuals(theta: np.ndarray) -> np.ndarray:
        # the slopes come with the residuals: keep them for the question that follows
        latest.clear()
        values, latest[theta.tobytes()] = _residuals(posterior, scale, theta)
        return values

    def slopes(theta: np.ndarray) -> np.ndarray:
        if theta.tobytes() not in latest:
            residuals(theta)
        return latest[theta.tobytes()]

    return minimise(residuals, inside, jac=slopes, bounds=bounds, x_scale="jac", max_nfev=200)


def _residuals(
    posterior: Posterior, scale: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    values, slopes = compiled.residuals_and_slopes(posterior, scale, theta)
    return np.asarray(values), np.asarray(slopes)


def normal_approximation(
    posterior: Posterior, scale: np.ndarray, theta: np.ndarray
) -> tuple[NormalApproximation, float]:
    """The textbook covariance s^2 (J^T J)^-1 at an optimum, and s (in units of ``scale``)."""
    values, slopes = _residuals(posterior, scale, theta)
    cost = float(np.sum(values**2))
    points = int(np.sum(np.asarray(posterior.record.blocks.real) & np.isfinite(scale)))
    variance = cost / max(points - theta.size, 1)
    curvature = slopes.T @ slopes / max(variance, 1e-300)
    return NormalApproximation(theta, covariance_from(curvature)), float(np.sqrt(variance))


def covariance_from(curvature: np.ndarray) -> np.ndarray:
    """Inverse of a curvature matrix (D, D), with sds of ``LARGEST_SD`` at most."""
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    kept = np.maximum(values, 1.0 / LARGEST_SD**2)
    return (vectors / kept) @ vectors.T
