"""Compute what effects need of a test's past, and the times that a study resolves."""

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


def dragged(displacement: Array, back: ArrayLike, ahead: ArrayLike) -> Array:
    """Return the place p (N,) of what d drags along: p in d - back to d + ahead, from p = d on."""
    low = xp.concatenate([displacement[:1], displacement[1:] - back])
    high = xp.concatenate([displacement[:1], displacement[1:] + ahead])
    return xp.accumulate(_confined, (low, high))[0]


def _confined(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the range that two ranges, applied one after the other, confine a place to."""
    low, high = second
    return xp.clip(first[0], low, high), xp.clip(first[1], low, high)


def fading(gain: ArrayLike, rate: ArrayLike) -> tuple[Linear, Prony]:
    """Return laws whose hereditary integral of x is y, with dy = gain dx - rate y dt, y(0) = 0."""
    return Linear(gain), Prony(np.array([0.0, 1.0]), xp.asarray(rate)[None])


def travelled(displacement: Array) -> Array:
    """Return the distance travelled (N,) since the first point."""
    return xp.cumsum(xp.abs(xp.steps(displacement)))


def material_time(time: Array, depth: Array, exponent: ArrayLike) -> Array:
    """Return the integral of e^{exponent depth} over time (N,), exact for straight lines."""
    steps = material_duration(xp.diff(time), depth[:-1], depth[1:], exponent)
    return time[0] + xp.concatenate([np.zeros(1), xp.cumsum(steps)])


def material_duration(duration: Array, start: Array, stop: Array, exponent: ArrayLike) -> Array:
    """Return the integral of e^{exponent depth} over time along a straight line."""
    return duration * xp.exp(exponent * start) * exp_slope(exponent * (stop - start))


def duration(scales: Scales) -> float:
    """Return the time (s) from the first test's beginning to the last one's end, above 0."""
    return max(scales.clock, _phase_and_sample(scales)[0])


def resolved_times(scales: Scales) -> tuple[float, float]:
    """Return the times (s) of five samples and of twice the longest phase."""
    longest, shortest = _phase_and_sample(scales)
    return min(5.0 * shortest, longest), 2.0 * longest


def resolved_rates(scales: Scales) -> tuple[float, float]:
    """Return the rates (1/s) that halve over the longest phase, and of a fifth of a sample's."""
    longest, shortest = _phase_and_sample(scales)
    return 0.5 / longest, max(0.2 / shortest, 1.0 / longest)


def _phase_and_sample(scales: Scales) -> tuple[float, float]:
    """Return the longest phase and the sampling interval (s), or guesses where none is known."""
    longest = scales.longest if scales.longest > 0.0 else 1.0
    return longest, scales.shortest if scales.shortest > 0.0 else 1e-3 * longest


LEVELS = 4.0
"""Prior sd of a slowing over one over the study's duration: it may level off within."""
REACHED = 0.3
"""Share of rate x duration that a drift reaches at the slowing's median."""
