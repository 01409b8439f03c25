"""Moments of a decaying exponential over one step, and steps of polynomial forces."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.laws.smoothmath import exp_slope

_NEAR = 0.3  # decay below which the series of 13 terms is exact to 1e-15; division is above it


def quadratic_force_step(f0: Array, fm: Array, f1: Array, decay: Array) -> Array:
    """Integral of e^{-decay(1-s)} dF/ds over s in (0,1), F quadratic through f0, fm, f1."""
    slope = 4.0 * fm - 3.0 * f0 - f1
    bend = 4.0 * (f0 + f1 - 2.0 * fm)
    return slope * exp_slope(-decay) + bend * first_moment(decay)


def first_moment(decay: Array) -> Array:
    """Integral of s e^{-decay(1-s)} over s in (0,1): (1 - M_0)/decay, 1/2 at no decay."""
    return _moment(decay, 1, exp_slope)


def second_moment(decay: Array) -> Array:
    """Integral of s^2 e^{-decay(1-s)} over s in (0,1): (1 - 2 M_1)/decay, 1/3 at no decay."""
    return _moment(decay, 2, lambda x: first_moment(-x))


def _moment(decay: Array, order: int, lower) -> Array:  # type: ignore[no-untyped-def]
    """Of order 1 or 2, by its series near zero and by the moment below it elsewhere.

    M_n = n! sum_k (-decay)^k / (n + 1 + k)!
    """
    near = decay < _NEAR
    close = jnp.where(near, decay, 0.0)
    far = jnp.where(near, 1.0, decay)
    series = jnp.full_like(close, 1.0 / (order + 14))
    for k in range(order + 13, order, -1):
        series = (1.0 - close * series) / k
    return jnp.where(near, series, (1.0 - order * lower(-far)) / far)
