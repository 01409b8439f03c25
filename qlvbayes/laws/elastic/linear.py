"""Define the linear elastic law."""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import moments
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant


class Linear(AbstractElastic):
    """Elastic force proportional to depth, F_e = m delta: a linear viscoelastic solid.

    Parameters
    ----------
    m
        Stiffness (N/mm).

    References
    ----------
    Tschoegl 1989, doi:10.1007/978-3-642-73602-5
    """

    m: Constant
    name: ClassVar[str] = "linear"
    units: ClassVar[dict[str, str]] = {"m": "stiffness"}
    meanings: ClassVar[dict[str, str]] = {"m": "stiffness before anything relaxes, at any depth"}
    law: ClassVar[str] = "K(δ) = m"
    reference: ClassVar[str] = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law with m within a factor of 5 (one sd) of the secant stiffness."""
        return cls(lognormal(scales.force / scales.depth, 5.0))

    def force(self, depth: Array) -> Array:
        """Return F_e = m depth."""
        return self.m * depth

    def stiffness(self, depth: Array) -> Array:
        """Return K = m at any depth."""
        return self.m * jnp.ones_like(depth)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Return m dd (1 - e^{-v h})/(v h), which is exact."""
        return self.m * (stop - start) * moments(decay, 1)[0]
