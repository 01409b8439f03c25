"""The reduced relaxation function g(t) as a Prony series."""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array


class Prony(eqx.Module):
    r"""g(t) = c_0 + sum_{i=1}^r c_i e^{-v_i t}, the paper's Eq. 7, with sum c = 1.

    c: (r + 1,) fractions, c[0] the part that never relaxes; v: (r,) rates (1/s), largest first.
    """

    c: Any
    v: Any
    units: ClassVar[dict[str, str]] = {"c": "fraction", "v": "rate"}
    first_index: ClassVar[dict[str, int]] = {"v": 1}

    def curve(self, time: Array) -> Array:
        """G at ``time`` (s), any shape."""
        decays = jnp.exp(-jnp.asarray(time)[..., None] * self.v)
        return self.c[0] + decays @ self.c[1:]
