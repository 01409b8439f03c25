"""Compute what effects need of a test's past: largest depth, play, fading memory, material time."""

from __future__ import annotations

import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.xp import Array


def largest(depth: Array, ago: Array | None = None) -> Array:
    """Return the largest ``depth`` (N,) so far in the test, at each point."""
    index = xp.along_first(np.arange(depth.shape[0]), depth[0])
    fixed = xp.fixed(depth)
    if ago is not None:  # puts every depth of an earlier test below those of a later one
        fixed = fixed - (2.0 * xp.max(xp.abs(fixed)) + 1.0) * ago
    return xp.take(depth, xp.cummax(xp.where(fixed >= xp.cummax(fixed), index, 0)))


def confined(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the range that two ranges, applied one after the other, confine a place to."""
    low, high = second
    return xp.clip(first[0], low, high), xp.clip(first[1], low, high)


def fading(gain: ArrayLike, rate: ArrayLike) -> tuple[Linear, Prony]:
    """Return laws whose hereditary integral of x is y, with dy = gain dx - rate y dt, y(0) = 0."""
    return Linear(gain), Prony(np.array([0.0, 1.0]), xp.asarray(rate)[None])


def material_time(time: Array, depth: Array, exponent: ArrayLike) -> Array:
    """Return the integral of e^{exponent depth} over time (N,), exact for straight lines."""
    steps = material_duration(xp.diff(time), depth[:-1], depth[1:], exponent)
    return time[0] + xp.concatenate([np.zeros(1), xp.cumsum(steps)])


def material_duration(duration: Array, start: Array, stop: Array, exponent: ArrayLike) -> Array:
    """Return the integral of e^{exponent depth} over time along a straight line."""
    return duration * xp.exp(exponent * start) * exp_slope(exponent * (stop - start))
