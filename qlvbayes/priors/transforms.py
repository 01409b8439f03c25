r"""Map unconstrained numbers to positive, bounded, simplex and ordered ones.

Each ``to_*`` returns the value and log\|d value / d y\|; each ``from_*`` inverts it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.xp import Array


def to_positive(y: Array) -> tuple[Array, Array]:
    """Return x = e^y and the log-Jacobian y."""
    return xp.exp(y), y


def to_interval(y: Array, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
    """Return x = low + (high - low) sigmoid(y) and the log-Jacobian."""
    low = xp.asarray(low)
    width = xp.asarray(high) - low
    log_volume = xp.log(width) + xp.log_sigmoid(y) + xp.log_sigmoid(-y)
    return low + width * xp.sigmoid(y), log_volume


def from_interval(x: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    """Return the y at which low + (high - low) sigmoid(y) is x."""
    return xp.log(xp.asarray(x) - low) - xp.log(high - xp.asarray(x))


def to_simplex(y: Array) -> tuple[Array, Array]:
    """Map (k - 1,) numbers to (k,) positive fractions that sum to one, by stick-breaking."""
    pieces = y.shape[0]
    shifted = y - xp.along_first(np.log(np.arange(pieces, 0, -1.0)), y.sum(axis=0))
    log_break, log_keep = xp.log_sigmoid(shifted), xp.log_sigmoid(-shifted)
    log_left = xp.concatenate([np.zeros(1), xp.cumsum(log_keep)])
    fractions = xp.exp(xp.concatenate([log_left[:-1] + log_break, log_left[-1:]]))
    return fractions, xp.sum(log_left[:-1] + log_break + log_keep)


def from_simplex(fractions: ArrayLike) -> Array:
    """Return the (k - 1,) numbers that ``to_simplex`` maps to these (k,) fractions."""
    shares: Array = xp.asarray(fractions)
    pieces = shares.shape[0] - 1
    after = xp.cumsum(shares[::-1])[::-1][1:]
    count = xp.along_first(np.log(np.arange(pieces, 0, -1.0)), shares[0])
    return xp.log(shares[:-1]) - xp.log(after) + count


def to_between(y: Array, low: Array | None, high: Array | None) -> tuple[Array, Array]:
    """Return x between ``low`` and ``high``, where either may be None, and the log-Jacobian."""
    if low is None and high is None:
        return y, xp.zeros_like(y)
    if low is not None and high is None:
        return low + xp.exp(y), y
    if high is not None and low is None:
        return high - xp.exp(y), y
    assert low is not None
    assert high is not None
    return to_interval(y, low, high)


def from_between(x: Array, low: Array | None, high: Array | None) -> Array:
    """Return the y that ``to_between(y, low, high)`` maps to x."""
    if low is None and high is None:
        return x
    if low is not None and high is None:
        return xp.log(x - low)
    if high is not None and low is None:
        return xp.log(high - x)
    assert low is not None
    assert high is not None
    return from_interval(x, low, high)
