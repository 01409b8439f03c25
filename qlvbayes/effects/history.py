"""What effects ask of a test's past: its largest depth, and time that runs by depth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from qlvbayes.smoothmath import exp_slope


def largest(depth: Array) -> Array:
    """Largest ``depth`` (N,) so far, at each point; its slope is that of the point it came from."""
    place = jnp.arange(depth.shape[0])
    fixed = jax.lax.stop_gradient(depth)
    return depth[jax.lax.cummax(jnp.where(fixed >= jax.lax.cummax(fixed), place, 0))]


def material_time(time: Array, depth: Array, exponent: ArrayLike) -> Array:
    r"""Integral of e^{exponent depth} over time from time[0] on, exact for straight lines."""
    before, travel = depth[:-1], jnp.diff(depth)
    steps = jnp.diff(time) * jnp.exp(exponent * before) * exp_slope(exponent * travel)
    return time[0] + jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])
