"""Fit a model by least squares from many starts, as the paper's routes do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult
from scipy.optimize import least_squares as minimise

from qlvbayes.fitting.posterior import Predictor
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.model.parameters import draw_priors

LARGEST_SD = 3.0  # natural lengths: of a direction that the data do not determine
_PRIOR_DRAWS = 96
_BOUND_SDS = 5.0
_LINEAR = 4.0  # times the predicted rise of the sum of squares that a draw may have
_HALVINGS = 12  # of a draw's step: to 1/4000 of a prior's width
_TOGETHER = 256  # draws whose residuals are held together


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


def least_squares(
    predictor: Predictor, scale: Array, rng: np.random.Generator, starts: int = 8
) -> LeastSquares:
    """Minimise the sum of ((block mean - model)/scale)^2 over the model's free constants."""
    # the optimiser's tolerance on gradients is absolute
    scale = scale * float(np.max(np.abs(predictor.record.blocks.force)))
    own, draws = predictor.parameters, draw_priors(predictor.model, _PRIOR_DRAWS, rng)
    centre, distance = draws.mean(axis=0), _BOUND_SDS * draws.std(axis=0)
    bounds = own.within(centre - distance), own.within(centre + distance)
    draws = np.clip(draws, *bounds)
    sums = _sums_of_squares(predictor, scale, draws)
    order = [k for k in np.argsort(sums) if np.isfinite(sums[k])]
    with np.errstate(over="ignore"):  # a sum that overflows is the worst
        optima = [_descend(predictor, scale, draws[k], bounds) for k in order[:starts]]
    if not optima:
        raise NoFiniteForceError
    optima.sort(key=lambda result: result.cost)
    return LeastSquares(tuple(r.x for r in optima), tuple(2.0 * float(r.cost) for r in optima))


def _descend(
    predictor: Predictor, scale: Array, start: Array, bounds: tuple[Array, Array]
) -> OptimizeResult:
    """Return the optimum that a start leads to."""
    inside = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)
    slopes_at: dict[bytes, np.ndarray] = {}

    def residuals(theta: np.ndarray) -> np.ndarray:
        # the derivatives come with the residuals, and the optimiser asks for them next
        slopes_at.clear()
        values, slopes_at[theta.tobytes()] = residuals_and_slopes(predictor, scale, theta)
        return values

    def slopes(theta: np.ndarray) -> np.ndarray:
        if theta.tobytes() not in slopes_at:
            residuals(theta)
        return slopes_at[theta.tobytes()]

    return minimise(residuals, inside, jac=slopes, bounds=bounds, x_scale="jac", max_nfev=200)


def residuals_and_slopes(predictor: Predictor, scale: Array, theta: Array) -> tuple[Array, Array]:
    """Return residuals (n,) of the block means over ``scale``, and their derivatives (n, D)."""
    _, forces, slopes = predictor.space.forces_and_slopes(predictor.hypothesis, theta)
    real = predictor.space.real
    values = ((np.asarray(predictor.record.blocks.force) - forces) / scale)[real]
    return values, -(slopes / scale)[:, real].T


def normal_approximation(
    predictor: Predictor, scale: Array, theta: Array
) -> tuple[NormalApproximation, float]:
    """Return the covariance s^2 (J^T J)^-1 about an optimum, and s in units of ``scale``."""
    values, slopes = residuals_and_slopes(predictor, scale, theta)
    variance = float(values @ values) / max(_fitted(predictor, scale) - theta.size, 1)
    curvature = slopes.T @ slopes / max(variance, 1e-300)
    covariance = covariance_from(curvature, predictor.parameters.length)
    return NormalApproximation(theta, covariance), float(np.sqrt(variance))


def fitting_draws(
    predictor: Predictor,
    scale: Array,
    normal: NormalApproximation,
    count: int,
    rng: np.random.Generator,
) -> Array:
    """Return draws (count, D) that fit about as well as the normal approximation says."""
    draws = predictor.parameters.within(normal.draw(count, rng))
    values, slopes = residuals_and_slopes(predictor, scale, normal.mean)
    cost, size = float(values @ values), normal.mean.size
    slack = cost * size / max(_fitted(predictor, scale) - size, 1)
    for _ in range(_HALVINGS):
        expected = np.sum(((draws - normal.mean) @ slopes.T) ** 2, axis=1)
        sums = _sums_of_squares(predictor, scale, draws)
        far = ~(sums <= cost + slack + _LINEAR * expected)
        if not far.any():
            break
        draws[far] = 0.5 * (draws[far] + normal.mean)
    return draws


def _sums_of_squares(predictor: Predictor, scale: Array, thetas: Array) -> Array:
    """Return the sums (K,) of squared residuals over ``scale`` at thetas (K, D)."""
    sums = []
    for k in range(0, len(thetas), _TOGETHER):
        constants = predictor.parameters.constants(thetas[k : k + _TOGETHER])
        with np.errstate(over="ignore", invalid="ignore"):
            some = (predictor.residuals(constants) / scale)[:, predictor.space.real]
            sums.append(np.sum(some**2, axis=1))
    return np.concatenate(sums)


def _fitted(predictor: Predictor, scale: Array) -> int:
    """Return the number of block means that count."""
    return int(np.sum(predictor.space.real & np.isfinite(scale)))


def covariance_from(curvature: Array, lengths: Array) -> Array:
    """Return the inverse of a curvature (D, D), with sds of ``LARGEST_SD`` lengths at most."""
    scaled = curvature * np.outer(lengths, lengths)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    limited = np.maximum(values, 1.0 / LARGEST_SD**2)
    return np.asarray((vectors / limited) @ vectors.T * np.outer(lengths, lengths))
