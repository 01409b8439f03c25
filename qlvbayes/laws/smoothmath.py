"""Compute divided differences of the exponential that are exact and smooth at 0/0."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

_NEAR = 0.04  # below this the series is exact to 1e-16; above it plain division loses 1e-14
_SERIES = tuple(1.0 / math.factorial(k + 1) for k in range(8))


def exp_slope(x: ArrayLike) -> Array:
    """Return (e^x - 1)/x, elementwise; it is 1 at x = 0."""
    x = jnp.asarray(x)
    near = jnp.abs(x) < _NEAR
    far = jnp.where(near, 1.0, x)
    return jnp.where(near, exp_slope_series(x), jnp.expm1(far) / far)


def exp_slope_series(x: Array) -> Array:
    """Return the Taylor series of (e^x - 1)/x through x^7, for abs(x) < 0.04."""
    total = jnp.full_like(x, _SERIES[-1])
    for coefficient in _SERIES[-2::-1]:
        total = total * x + coefficient
    return total


def exp_growth(x: Array, rate: Array) -> Array:
    """Return (e^(rate x) - 1)/rate for an array x and one rate; it is x itself at rate = 0."""
    small = jnp.abs(rate) * jnp.max(jnp.abs(x), initial=0.0) < _NEAR
    divisor = jnp.where(small, 1.0, rate)
    series = x * exp_slope_series(jnp.where(small, rate * x, 0.0))
    return jnp.where(small, series, jnp.expm1(rate * x) / divisor)


def exp_difference_ratio(top: Array, bottom: Array, gap: Array) -> Array:
    """Return (top - bottom)/gap with top = bottom e^gap: a divided difference of exponentials."""
    near = jnp.abs(gap) < _NEAR
    far = jnp.where(near, 1.0, gap)
    # near: the series needs a small argument only, so that its unused branch cannot overflow
    close = jnp.where(near, gap, 0.0)
    return jnp.where(near, bottom * exp_slope_series(close), (top - bottom) / far)
