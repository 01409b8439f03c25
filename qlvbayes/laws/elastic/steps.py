r"""Compute moments of a decaying exponential over one step, and steps of polynomial forces.

.. math:: M_n(a) = \int_0^1 s^n e^{-a (1 - s)} ds, \quad M_n = \frac{1 - n M_{n-1}}{a}, \quad
          M_0 = \frac{1 - e^{-a}}{a}
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array

_NEAR = 0.3  # decay below which a series of 13 terms is exact to 1e-15, and above which division is
_TERMS = 13


def moments(decay: Array, count: int) -> list[Array]:
    """Return the moments M_0, M_1, ..., ``count`` of them, each of the shape of ``decay``."""
    near = decay < _NEAR
    close = jnp.where(near, decay, 0.0)
    last = jnp.full_like(close, 1.0 / (count + _TERMS))
    for k in range(count + _TERMS - 1, count - 1, -1):
        last = (1.0 - close * last) * (1.0 / k)
    by_series = [last]
    for n in range(count - 1, 0, -1):
        by_series.insert(0, (1.0 - close * by_series[0]) * (1.0 / n))
    inverse = 1.0 / jnp.where(near, 1.0, decay)
    by_division = [(1.0 - jnp.exp(-decay)) * inverse]
    for n in range(1, count):
        by_division.append((1.0 - n * by_division[-1]) * inverse)
    return [jnp.where(near, *both) for both in zip(by_series, by_division, strict=True)]


def quadratic_force_step(f0: Array, fm: Array, f1: Array, decay: Array) -> Array:
    """Return the integral of e^{-decay (1 - s)} dF/ds over s in (0, 1), F quadratic in s."""
    slope = 4.0 * fm - 3.0 * f0 - f1
    curvature = 4.0 * (f0 + f1 - 2.0 * fm)
    zeroth, first = moments(decay, 2)
    return slope * zeroth + curvature * first
