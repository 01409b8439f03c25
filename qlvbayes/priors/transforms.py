r"""Map unconstrained numbers to positive, bounded, simplex and ordered ones.

Each ``to_*`` returns the value and log\|d value / d y\|; each ``from_*`` inverts it.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike


def to_positive(y: Array) -> tuple[Array, Array]:
    """Return x = e^y and the log-Jacobian y."""
    return jnp.exp(y), y


def to_interval(y: Array, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
    """Return x = low + (high - low) sigmoid(y) and the log-Jacobian."""
    low = jnp.asarray(low)
    width = jnp.asarray(high) - low
    log_volume = jnp.log(width) + jax.nn.log_sigmoid(y) + jax.nn.log_sigmoid(-y)
    return low + width * jax.nn.sigmoid(y), log_volume


def from_interval(x: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    """Return the y at which low + (high - low) sigmoid(y) is x."""
    return jnp.log(jnp.asarray(x) - low) - jnp.log(high - jnp.asarray(x))


def to_simplex(y: Array) -> tuple[Array, Array]:
    """Map (k - 1,) numbers to (k,) positive fractions that sum to one, by stick-breaking."""
    pieces = y.shape[0]
    shifted = y - jnp.log(jnp.arange(pieces, 0, -1.0))
    log_break, log_keep = jax.nn.log_sigmoid(shifted), jax.nn.log_sigmoid(-shifted)
    log_left = jnp.concatenate([jnp.zeros(1), jnp.cumsum(log_keep)])
    fractions = jnp.exp(jnp.append(log_left[:-1] + log_break, log_left[-1]))
    return fractions, jnp.sum(log_left[:-1] + log_break + log_keep)


def from_simplex(fractions: ArrayLike) -> Array:
    """Return the (k - 1,) numbers that ``to_simplex`` maps to these (k,) fractions."""
    fractions = jnp.asarray(fractions)
    pieces = fractions.shape[0] - 1
    after = jnp.flip(jnp.cumsum(jnp.flip(fractions)))[1:]
    return jnp.log(fractions[:-1]) - jnp.log(after) + jnp.log(jnp.arange(pieces, 0, -1.0))


def to_between(y: Array, low: Array | None, high: Array | None) -> tuple[Array, Array]:
    """Return x between ``low`` and ``high``, where either may be None, and the log-Jacobian."""
    if low is None and high is None:
        return y, jnp.zeros_like(y)
    if low is not None and high is None:
        return low + jnp.exp(y), y
    if high is not None and low is None:
        return high - jnp.exp(y), y
    assert low is not None
    assert high is not None
    return to_interval(y, low, high)


def from_between(x: Array, low: Array | None, high: Array | None) -> Array:
    """Return the y that ``to_between(y, low, high)`` maps to x."""
    if low is None and high is None:
        return x
    if low is not None and high is None:
        return jnp.log(x - low)
    if high is not None and low is None:
        return jnp.log(high - x)
    assert low is not None
    assert high is not None
    return from_interval(x, low, high)
