"""Provide the compiled functions of the fit, which all posteriors of one shape share."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.model.model import Model
from qlvbayes.model.posterior import Posterior
from qlvbayes.motion.record import Record


@jax.jit
def log_densities(posterior: Posterior, thetas: Array) -> Array:
    """Return log densities (W,) at thetas (W, D)."""
    return jax.vmap(posterior.log_density)(thetas)


@jax.jit
def loss_and_gradient(posterior: Posterior, theta: Array) -> tuple[Array, Array]:
    """Return minus the log density and its gradient (D,) at theta (D,)."""
    return _value_and_slopes(lambda x: -posterior.log_density(x), theta)


@jax.jit
def residuals_and_slopes(posterior: Posterior, scale: Array, theta: Array) -> tuple[Array, Array]:
    """Return residuals (T*B,) of the block means over ``scale``, and their derivatives (T*B, D)."""
    return _value_and_slopes(lambda x: _residuals(posterior, scale, x), theta)


@jax.jit
def sums_of_squares(posterior: Posterior, scale: Array, thetas: Array) -> Array:
    """Return the sums (W,) of squared residuals over ``scale`` at thetas (W, D)."""
    return jax.vmap(lambda x: jnp.sum(_residuals(posterior, scale, x) ** 2))(thetas)


def response(posterior: Posterior, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives (D, T, B) of the force at theta (D,), and residuals (T, B)."""
    shape = posterior.record.blocks.force.shape
    residual, slopes = residuals_and_slopes(posterior, jnp.ones(shape), theta)
    slopes = np.moveaxis(np.asarray(slopes).reshape(*shape, -1), -1, 0)
    return -slopes, np.asarray(residual).reshape(shape)


@jax.jit
def beyond_gaps(model: Model, record: Record, gaps: Array) -> Array:
    """Return block means (T, B) of the force where contact lies at gaps (T,) of displacement."""

    def one(record: Record, gap: Array) -> Array:
        return record.average((model + ContactOffset(gap)).force(record.motion))

    return jax.vmap(one)(record, gaps)


@jax.jit
def prior_terms(posterior: Posterior, theta: Array) -> tuple[Array, Array]:
    """Return gradient (D,) and curvature (D, D) of minus the log prior density at theta (D,)."""

    def loss(theta: Array) -> Array:
        return -posterior.bind(theta)[2]

    return jax.grad(loss)(theta), jax.hessian(loss)(theta)


@jax.jit
def constants(posterior: Posterior, thetas: Array) -> Array:
    """Return constants (W, P) at thetas (W, D)."""
    return jax.vmap(posterior.constants)(thetas)


@jax.jit
def drawn_constants(posterior: Posterior, thetas: Array, shares: Array) -> Array:
    """Return constants (W, P) at thetas (W, D), with noise and discrepancy drawn."""
    return jax.vmap(posterior.drawn_constants)(thetas, shares)


@jax.jit
def judgements(posterior: Posterior, thetas: Array, keys: Array) -> Array:
    """Return pointwise log likelihoods and replicated block means, (W, 2, T, B) together."""

    def one(theta: Array, key: Array) -> Array:
        model, noise, _ = posterior.bind(theta)
        blocks = posterior.record.blocks
        predicted = posterior.predict_with(model)
        likelihood = jax.vmap(noise.log_likelihoods)(blocks.force - predicted, blocks)
        draws = jax.vmap(noise.draw)(jax.random.split(key, len(predicted)), blocks)
        return jnp.stack([likelihood, predicted + draws])

    return jax.vmap(one)(thetas, keys)


@jax.jit
def predictions(posterior: Posterior, constants: Array) -> Array:
    """Return block means (W, T, B) predicted by constants (W, P), without noise."""
    return jax.vmap(lambda x: posterior.predict_with(posterior.with_constants(x)[0]))(constants)


def in_batches(
    function: Callable[..., Array], posterior: Posterior, *arrays: np.ndarray, size: int = 256
) -> np.ndarray:
    """Return ``function(posterior, *arrays)`` over the first axis, ``size`` rows at a time."""
    count = len(arrays[0])
    out = []
    for start in range(0, count, size):
        rows = np.minimum(np.arange(start, start + size), count - 1)
        out.append(np.asarray(function(posterior, *(array[rows] for array in arrays))))
    return np.concatenate(out)[:count]


def _value_and_slopes(function: Callable[[Array], Array], theta: Array) -> tuple[Array, Array]:
    """Return a function and its derivatives in one pass."""

    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(function, (theta,), (direction,))

    return jax.vmap(along, out_axes=(None, -1))(jnp.eye(theta.size))


def _residuals(posterior: Posterior, scale: Array, theta: Array) -> Array:
    """Return the residuals (T*B,) of the block means over ``scale``, 0 in padding."""
    blocks = posterior.record.blocks
    difference = (blocks.force - posterior.predict(theta)) / scale
    return jnp.where(blocks.real, difference, 0.0).reshape(-1)
