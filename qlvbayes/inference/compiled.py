"""The functions that inference compiles, shared by every posterior of one shape."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.posterior import Posterior


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


@jax.jit
def constants(posterior: Posterior, thetas: Array) -> Array:
    """(W, D) flat vectors to (W, P) constants."""
    return jax.vmap(posterior.constants)(thetas)


@jax.jit
def log_likelihoods(posterior: Posterior, thetas: Array) -> Array:
    """(W, T, B) pointwise log likelihoods."""
    return jax.vmap(posterior.log_likelihoods)(thetas)


@jax.jit
def replicates(posterior: Posterior, thetas: Array, keys: Array) -> Array:
    """(W, T, B) block means predicted with new noise."""

    def one(theta: Array, key: Array) -> Array:
        model, noise, _ = posterior.bind(theta)
        tests = posterior.record.blocks.force.shape[0]
        draws = jax.vmap(noise.draw)(jax.random.split(key, tests), posterior.record.blocks)
        return posterior.predict_with(model) + draws

    return jax.vmap(one)(thetas, keys)


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
