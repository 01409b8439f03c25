"""The exponential elastic law."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.laws.smoothmath import exp_difference_ratio, exp_growth


class Exponential(AbstractElastic):
    """F_e = (m/b)(e^{b delta} - 1), the paper's Eq. 8; linear, m delta, at b = 0.

    m: initial stiffness (N/mm); b: stiffening (1/mm).
    """

    m: Any
    b: Any
    name: ClassVar[str] = "exponential"
    units: ClassVar[dict[str, str]] = {"m": "stiffness", "b": "exponent"}
    meanings: ClassVar[dict[str, str]] = {
        "m": "stiffness at first contact, before anything relaxes",
        "b": "how fast stiffness grows with depth",
    }
    law: ClassVar[str] = "K(δ) = m exp(b δ)"
    reference: ClassVar[str] = "Fung 1967, doi:10.1152/ajplegacy.1967.213.6.1532"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """M within a factor 5 (one sd) of the secant stiffness, b of one over the depth."""
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        return cls(stiffness, lognormal(1.0 / scales.depth, 5.0))

    def force(self, depth: Array) -> Array:
        """(m/b)(e^{b depth} - 1)."""
        return self.m * exp_growth(depth, self.b)

    def stiffness(self, depth: Array) -> Array:
        """K = m e^{b depth}."""
        return self.m * jnp.exp(self.b * depth)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Exact: m dd (e^{b d1} - e^{b d0 - v h}) / (b dd + v h)."""
        travel = stop - start
        stiffness_start = (self.m + self.b * force_start) * jnp.exp(-decay)
        stiffness_stop = self.m + self.b * force_stop
        return travel * exp_difference_ratio(
            stiffness_stop, stiffness_start, self.b * travel + decay
        )
