"""Compute divided differences of the exponential that are exact and smooth at 0/0."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.xp import Array

_NEAR = 0.04  # below this the series is exact to 1e-16; above it plain division loses 1e-14
_SERIES = tuple(1.0 / math.factorial(k + 1) for k in range(8))


def exp_slope(x: ArrayLike) -> Array:
    """Return (e^x - 1)/x, elementwise; it is 1 at x = 0."""
    x = xp.asarray(x)
    if xp.on_numpy(x):  # which needs no derivative at 0
        return np.where(x == 0.0, 1.0, np.expm1(x) / np.where(x == 0.0, 1.0, x))
    near = xp.abs(x) < _NEAR
    far = xp.where(near, 1.0, x)
    return xp.where(near, exp_slope_series(x), xp.expm1(far) / far)


def exp_slope_series(x: Array) -> Array:
    """Return the Taylor series of (e^x - 1)/x through x^7, for abs(x) < 0.04."""
    total = xp.full_like(x, _SERIES[-1])
    for coefficient in _SERIES[-2::-1]:
        total = total * x + coefficient
    return total


def exp_growth(x: Array, rate: Array) -> Array:
    """Return (e^(rate x) - 1)/rate for an array x and one rate; it is x itself at rate = 0."""
    if xp.on_numpy(x, rate):  # which needs no derivative at 0
        return np.where(rate == 0.0, x, np.expm1(rate * x) / np.where(rate == 0.0, 1.0, rate))
    small = jnp.abs(rate) * jnp.max(jnp.abs(x), initial=0.0) < _NEAR
    divisor = xp.where(small, 1.0, rate)
    series = x * exp_slope_series(xp.where(small, rate * x, 0.0))
    return xp.where(small, series, xp.expm1(rate * x) / divisor)


def exp_difference_ratio(top: Array, bottom: Array, gap: Array) -> Array:
    """Return (top - bottom)/gap with top = bottom e^gap: a divided difference of exponentials."""
    near = xp.abs(gap) < _NEAR
    far = xp.where(near, 1.0, gap)
    # near: the series needs a small argument only, so that its unused branch cannot overflow
    close = xp.where(near, gap, 0.0)
    return xp.where(near, bottom * exp_slope_series(close), (top - bottom) / far)
