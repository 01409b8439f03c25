"""A smooth curve over a study's clock, for effects that name nothing."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

LARGEST = 2.0
"""Of the curve below where ``bend`` and ``twist`` have their priors' sd of 1, within a half."""


def curve(clock: Array, bend: ArrayLike, twist: ArrayLike, duration: ArrayLike) -> Array:
    """P1 + bend P2 + twist P3, Legendre's polynomials over the clock from 0 to ``duration`` (s).

    After the study it stays as it was at its end.
    """
    x = jnp.clip(2.0 * clock / duration - 1.0, -1.0, 1.0)
    return x + 0.5 * bend * (3.0 * x**2 - 1.0) + 0.5 * twist * (5.0 * x**2 - 3.0) * x
