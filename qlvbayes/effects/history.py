"""Compute what effects need of a test's past: largest depth, play, fading memory, material time."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.smoothmath import exp_slope


def largest(depth: Array, ago: Array | None = None) -> Array:
    """Return the largest ``depth`` (N,) so far in the test, at each point.

    Its slope is that of the point it came from. ``ago`` says in which test each point lies, as in
    `Motion`; each test has a largest depth of its own.
    """
    index = jnp.arange(depth.shape[0])
    fixed = jax.lax.stop_gradient(depth)
    if ago is not None:  # puts every depth of an earlier test below those of a later one
        fixed = fixed - (2.0 * jnp.max(jnp.abs(fixed)) + 1.0) * ago
    return depth[jax.lax.cummax(jnp.where(fixed >= jax.lax.cummax(fixed), index, 0))]


def confined(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the range that two ranges, applied one after the other, confine a place to."""
    low, high = second
    return jnp.clip(first[0], low, high), jnp.clip(first[1], low, high)


def fading(gain: ArrayLike, rate: ArrayLike) -> tuple[Linear, Prony]:
    """Return laws whose hereditary integral of x is y, with dy = gain dx - rate y dt, y(0) = 0."""
    return Linear(gain), Prony(jnp.array([0.0, 1.0]), jnp.reshape(jnp.asarray(rate, float), (1,)))


def material_time(time: Array, depth: Array, exponent: ArrayLike) -> Array:
    """Return the integral of e^{exponent depth} over time (N,), exact for straight lines."""
    steps = material_duration(jnp.diff(time), depth[:-1], depth[1:], exponent)
    return time[0] + jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])


def material_duration(duration: Array, start: Array, stop: Array, exponent: ArrayLike) -> Array:
    """Return the integral of e^{exponent depth} over time along a straight line."""
    return duration * jnp.exp(exponent * start) * exp_slope(exponent * (stop - start))
