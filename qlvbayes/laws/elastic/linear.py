"""The linear spring."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import moments
from qlvbayes.laws.scales import Scales, lognormal


class Linear(AbstractElastic):
    """F_e = m delta (m in N/mm): the linear viscoelastic solid."""

    m: Any
    name: ClassVar[str] = "linear"
    units: ClassVar[dict[str, str]] = {"m": "stiffness"}
    meanings: ClassVar[dict[str, str]] = {"m": "stiffness before anything relaxes, at any depth"}
    law: ClassVar[str] = "K(δ) = m"
    reference: ClassVar[str] = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """M within a factor 5 (one sd) of the secant stiffness."""
        return cls(lognormal(scales.force / scales.depth, 5.0))

    def force(self, depth: Array) -> Array:
        """F_e = m depth."""
        return self.m * depth

    def stiffness(self, depth: Array) -> Array:
        """K = m, at any depth."""
        return self.m * jnp.ones_like(depth)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Exact: m dd (1 - e^{-v h})/(v h)."""
        return self.m * (stop - start) * moments(decay, 1)[0]
