"""What effects ask of a test's past: its largest depth, what fades, and time that runs by depth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.smoothmath import exp_slope


def largest(depth: Array, ago: Array | None = None) -> Array:
    """Largest ``depth`` (N,) so far in the test, at each point.

    Its slope is that of the point it came from. ``ago``: the tests that the points lie in, as in
    `Motion`; each has a largest depth of its own.
    """
    place = jnp.arange(depth.shape[0])
    fixed = jax.lax.stop_gradient(depth)
    if ago is not None:  # no depth of an earlier test comes up to one of a later test
        fixed = fixed - (2.0 * jnp.max(jnp.abs(fixed)) + 1.0) * ago
    return depth[jax.lax.cummax(jnp.where(fixed >= jax.lax.cummax(fixed), place, 0))]


def fading(gain: ArrayLike, rate: ArrayLike) -> tuple[Linear, Prony]:
    """Laws by which the hereditary integral of x gives y with dy = gain dx - rate y dt, y = 0."""
    return Linear(gain), Prony(jnp.array([0.0, 1.0]), jnp.reshape(jnp.asarray(rate, float), (1,)))


def material_time(time: Array, depth: Array, exponent: ArrayLike) -> Array:
    r"""Integral of e^{exponent depth} over time from time[0] on, exact for straight lines."""
    steps = material_duration(jnp.diff(time), depth[:-1], depth[1:], exponent)
    return time[0] + jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])


def material_duration(duration: Array, start: Array, stop: Array, exponent: ArrayLike) -> Array:
    r"""Integral of e^{exponent depth} over a straight line from one depth to another."""
    return duration * jnp.exp(exponent * start) * exp_slope(exponent * (stop - start))
