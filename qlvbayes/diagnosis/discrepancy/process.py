"""The Gaussian process of a discrepancy: its kernel, its fit to residuals, its mean elsewhere."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import minimize
from tinygp import GaussianProcess, kernels
from tinygp.noise import Dense

_STEPS = 30  # of the optimiser
_FAR = 4.0  # from the first guess of a log scale
_WIDE = 1.5  # sd of a log scale about the first guess

Numbers = Any  # an array of JAX or of numpy


class Inputs(NamedTuple):
    """Where the process is looked at, each (N,).

    log_time: since the phase began; depth: in units of the largest; log_rate: of the first ramp;
    size: g; phase: its kind; test: which.
    """

    log_time: Numbers
    depth: Numbers
    log_rate: Numbers
    size: Numbers
    phase: Numbers
    test: Numbers


class Residuals(NamedTuple):
    """Points of all tests: inputs, residual (N,) in N, covariance (N, N) of its noise in N^2."""

    inputs: Any
    residual: Numbers
    noise: Numbers


class Kernel(kernels.Kernel):
    """The covariance k(x, x') that the package's docstring gives.

    log_scales: log of a, p (N), and of the lengths in time, depth and rate.
    """

    log_scales: Array

    def evaluate(self, X1: Any, X2: Any) -> Array:
        """Covariance (N^2) of two points."""
        shared, own, time, depth, rate = jnp.exp(self.log_scales)
        near = _matern(X1.log_time, X2.log_time, time) * _matern(X1.depth, X2.depth, depth)
        near *= X1.size * X2.size * (X1.phase == X2.phase)
        alike = shared**2 * _matern(X1.log_rate, X2.log_rate, rate)
        return near * (alike + own**2 * (X1.test == X2.test))


def _matern(one: Array, two: Array, length: Array) -> Array:
    return kernels.Matern32(length).evaluate(one, two)


def first_guess(residuals: Residuals) -> np.ndarray:
    """Sizes as the residuals', a length of two in time and rate, a third of the depth."""
    known = residuals.residual[residuals.residual != 0.0]
    size = 0.5 * np.log(np.mean(known**2)) if known.size else 0.0
    return np.array([size, size, np.log(2.0), np.log(0.3), np.log(2.0)])


def fit_scales(residuals: Residuals, start: np.ndarray) -> np.ndarray:
    """Log scales (5,) of the highest marginal likelihood, about the first guess."""
    middle = first_guess(residuals)

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _loss(x, residuals, middle)
        return float(value), np.asarray(slope)

    limits = list(zip(middle - _FAR, middle + _FAR, strict=True))
    found = minimize(
        loss, start, jac=True, method="L-BFGS-B", bounds=limits, options={"maxiter": _STEPS}
    )
    return np.asarray(found.x)


@jax.jit
def conditional(log_scales: Array, residuals: Residuals, at: Any) -> tuple[Array, Array]:
    """Mean (M,) in N and variance (M,) in N^2 of the discrepancy at other Inputs."""
    process = _process(log_scales, residuals)
    cross = process.kernel(residuals.inputs, at)
    white = process.solver.solve_triangular(cross)
    mean = white.T @ process.solver.solve_triangular(residuals.residual)
    return mean, jnp.maximum(process.kernel(at) - jnp.sum(white**2, axis=0), 0.0)


@jax.jit
def _loss(log_scales: Array, residuals: Residuals, middle: Array) -> tuple[Array, Array]:
    """Minus log marginal likelihood, with a wide normal about ``middle``; gradient."""

    def loss(x: Array) -> Array:
        wide = jnp.sum((x - middle) ** 2) / (2.0 * _WIDE**2)
        return -_process(x, residuals).log_probability(residuals.residual) + wide

    return jax.value_and_grad(loss)(log_scales)


def _process(log_scales: Array, residuals: Residuals) -> GaussianProcess:
    return GaussianProcess(Kernel(log_scales), residuals.inputs, noise=Dense(residuals.noise))
