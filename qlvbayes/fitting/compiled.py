"""The functions that inference compiles, shared by every posterior of one shape."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.effects.contact_offset import ContactOffset
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.posterior import Posterior
from qlvbayes.motion.record import Blocks, Record


@jax.jit
def log_densities(posterior: Posterior, thetas: Array) -> Array:
    """(W, D) flat vectors to (W,) log densities."""
    return jax.vmap(posterior.log_density)(thetas)


@jax.jit
def loss_and_gradient(posterior: Posterior, theta: Array) -> tuple[Array, Array]:
    """Minus log density and its gradient (D,) at theta (D,)."""
    return _value_and_slopes(lambda x: -posterior.log_density(x), theta)


@jax.jit
def residuals_and_slopes(posterior: Posterior, scale: Array, theta: Array) -> tuple[Array, Array]:
    """(T*B,) differences of block means from the model over ``scale``, and (T*B, D) slopes."""
    return _value_and_slopes(lambda x: _residuals(posterior, scale, x), theta)


def response(posterior: Posterior, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(D, T, B) slopes of the force along the free numbers at theta (D,), and (T, B) what is left.

    Both of block means, in N.
    """
    shape = posterior.record.blocks.force.shape
    left, slopes = residuals_and_slopes(posterior, jnp.ones(shape), theta)
    slopes = np.moveaxis(np.asarray(slopes).reshape(*shape, -1), -1, 0)
    return -slopes, np.asarray(left).reshape(shape)


@jax.jit
def beyond_gaps(model: Model, record: Record, gaps: Array) -> Array:
    """Block means (T, B) of a model of numbers where contact lies at gaps (T,) of displacement."""

    def one(record: Record, gap: Array) -> Array:
        return record.average((model + ContactOffset(gap)).force(record.motion))

    return jax.vmap(one)(record, gaps)


@jax.jit
def prior_terms(posterior: Posterior, theta: Array) -> tuple[Array, Array]:
    """Gradient (D,) and curvature (D, D) of minus the log prior density at theta (D,)."""

    def loss(theta: Array) -> Array:
        return -posterior.bind(theta)[2]

    return jax.grad(loss)(theta), jax.hessian(loss)(theta)


@jax.jit
def constants(posterior: Posterior, thetas: Array) -> Array:
    """(W, D) flat vectors to (W, P) constants."""
    return jax.vmap(posterior.constants)(thetas)


@jax.jit
def drawn_constants(posterior: Posterior, thetas: Array, shares: Array) -> Array:
    """The same, with what the likelihood sums over drawn by shares (W,) between 0 and 1."""
    return jax.vmap(posterior.drawn_constants)(thetas, shares)


@jax.jit
def judgements(posterior: Posterior, thetas: Array, keys: Array) -> Array:
    """(W, 2, T, B): pointwise log likelihoods, and block means predicted with new noise."""

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
    """(W, T, B) block means predicted by (W, P) constants, without noise."""
    return jax.vmap(lambda x: posterior.predict_with(posterior.with_constants(x)[0]))(constants)


@jax.jit
def noise_draws(noise: AbstractNoise, blocks: Blocks, keys: Array) -> Array:
    """(W, T, B) realisations of one noise model, a key each."""

    def one(key: Array) -> Array:
        return jax.vmap(noise.draw)(jax.random.split(key, blocks.force.shape[0]), blocks)

    return jax.vmap(one)(keys)


def in_batches(
    function: Callable[..., Array], posterior: Posterior, *arrays: np.ndarray, size: int = 256
) -> np.ndarray:
    """``function(posterior, *arrays)`` over the first axis, ``size`` at a time.

    The last batch is filled up, so that one compiled function serves any number.
    """
    count = len(arrays[0])
    out = []
    for start in range(0, count, size):
        rows = np.minimum(np.arange(start, start + size), count - 1)
        out.append(np.asarray(function(posterior, *(array[rows] for array in arrays))))
    return np.concatenate(out)[:count]


def _value_and_slopes(function: Callable[[Array], Array], theta: Array) -> tuple[Array, Array]:
    """A function and its derivatives in one pass.

    Forward mode: with a dozen constants it compiles and runs faster here than reverse mode.
    """

    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(function, (theta,), (direction,))

    return jax.vmap(along, out_axes=(None, -1))(jnp.eye(theta.size))


def _residuals(posterior: Posterior, scale: Array, theta: Array) -> Array:
    blocks = posterior.record.blocks
    difference = (blocks.force - posterior.predict(theta)) / scale
    return jnp.where(blocks.real, difference, 0.0).reshape(-1)
