"""What effects ask of a study's clock: times and rates it tells, and a smooth curve over it."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from qlvbayes.laws.scales import Scales

LARGEST = 2.0
"""Of the curve below with ``quadratic`` and ``cubic`` at their priors' sd of 1, within a half."""


def duration(scales: Scales) -> float:
    """Time (s) from the first test's beginning to the last one's end, above 0."""
    return max(scales.clock, _longest(scales))


def resolved_times(scales: Scales) -> tuple[float, float]:
    """Times (s) from five samples to twice the longest phase."""
    high = 2.0 * _longest(scales)
    return min(5.0 * _shortest(scales), 0.5 * high), high


def resolved_rates(scales: Scales) -> tuple[float, float]:
    """Rates (1/s) that decay to a half over the longest phase, up to a fifth of a sample's."""
    low = 0.5 / _longest(scales)
    return low, max(0.2 / _shortest(scales), 2.0 * low)


def _longest(scales: Scales) -> float:
    """The longest phase (s), or a guess where none is known."""
    return scales.longest if scales.longest > 0.0 else 1.0


def _shortest(scales: Scales) -> float:
    """The sampling interval (s), or a guess where none is known."""
    return scales.shortest if scales.shortest > 0.0 else 1e-3 * _longest(scales)


def curve(clock: Array, quadratic: ArrayLike, cubic: ArrayLike, duration: ArrayLike) -> Array:
    """P1 + quadratic P2 + cubic P3, of Legendre, over the clock from 0 to ``duration`` (s).

    After the study it stays as it was at its end.
    """
    x = jnp.clip(2.0 * clock / duration - 1.0, -1.0, 1.0)
    return x + 0.5 * quadratic * (3.0 * x**2 - 1.0) + 0.5 * cubic * (5.0 * x**2 - 3.0) * x
