"""Compute what effects need of a test's past and of a study's clock."""

from __future__ import annotations

import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
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


LARGEST = 2.0
"""Largest value of `curve`, within 50 %, for ``quadratic`` and ``cubic`` at their priors' sd."""


def duration(scales: Scales) -> float:
    """Return the time (s) from the first test's beginning to the last one's end, above 0."""
    return max(scales.clock, _longest(scales))


def resolved_times(scales: Scales) -> tuple[float, float]:
    """Return the times (s) of five samples and of twice the longest phase."""
    high = 2.0 * _longest(scales)
    return min(5.0 * _shortest(scales), 0.5 * high), high


def after_ramps(scales: Scales) -> tuple[float, float]:
    """Return times (s) of the fastest ramp, or of five samples, and of twice the longest phase."""
    low, high = resolved_times(scales)
    ramp = scales.depth / scales.speed if scales.speed > 0.0 else low
    return min(max(low, ramp), 0.5 * high), high


def resolved_rates(scales: Scales) -> tuple[float, float]:
    """Return the rates (1/s) that halve over the longest phase, and of a fifth of a sample's."""
    low = 0.5 / _longest(scales)
    return low, max(0.2 / _shortest(scales), 2.0 * low)


def _longest(scales: Scales) -> float:
    """Return the longest phase (s), or a guess where none is known."""
    return scales.longest if scales.longest > 0.0 else 1.0


def _shortest(scales: Scales) -> float:
    """Return the sampling interval (s), or a guess where none is known."""
    return scales.shortest if scales.shortest > 0.0 else 1e-3 * _longest(scales)


def curve(clock: Array, quadratic: ArrayLike, cubic: ArrayLike, duration: ArrayLike) -> Array:
    """Return P1 + quadratic P2 + cubic P3, of Legendre, over a clock from 0 to ``duration`` (s)."""
    x = xp.clip(2.0 * clock / duration - 1.0, -1.0, 1.0)
    return x + 0.5 * quadratic * (3.0 * x**2 - 1.0) + 0.5 * cubic * (5.0 * x**2 - 3.0) * x
