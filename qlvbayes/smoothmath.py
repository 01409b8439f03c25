"""Divided differences of the exponential that stay exact, with finite gradients, at 0/0."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

_NEAR = 0.1  # below this the series is exact to 1e-16; above it plain division loses no more


def exp_slope(x: ArrayLike) -> Array:
    """(e^x - 1)/x, elementwise, equal to 1 at x = 0."""
    x = jnp.asarray(x)
    near = jnp.abs(x) < _NEAR
    far = jnp.where(near, 1.0, x)
    return jnp.where(near, exp_slope_series(x), jnp.expm1(far) / far)


def exp_slope_series(x: Array) -> Array:
    """Taylor series of (e^x - 1)/x through x^8, for abs(x) < 0.1."""
    total = jnp.ones_like(x)
    for k in range(9, 1, -1):
        total = 1.0 + total * x / k
    return total


def exp_difference_ratio(top: Array, bottom: Array, gap: Array) -> Array:
    """(top - bottom)/gap where top = bottom e^gap: the divided difference of an exponential.

    ``top`` and ``bottom`` are known already, so no further exponential is evaluated. At
    ``gap = 0``, which ordinary unloading reaches (b gamma = -v_i), the value is ``bottom``.
    """
    near = jnp.abs(gap) < _NEAR
    far = jnp.where(near, 1.0, gap)
    # near: the series needs a small argument only, so that its unused branch cannot overflow
    close = jnp.where(near, gap, 0.0)
    return jnp.where(near, bottom * exp_slope_series(close), (top - bottom) / far)
