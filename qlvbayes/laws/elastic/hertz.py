"""Hertz's contact, and other powers of the depth."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import quadratic_force_step
from qlvbayes.laws.scales import Scales, lognormal


class HertzPower(AbstractElastic):
    """F_e = m delta^n; n = 3/2 is Hertz's contact of a sphere on a flat (1882).

    m: force at 1 mm (N/mm^n); n: exponent, above 1. Odd in the depth. The hereditary step has no
    closed form; it is integrated with the Prony exponential taken exactly and the force F_e
    taken as quadratic over the step; the error falls at least as the square of the step.
    """

    m: Any
    n: Any
    name: ClassVar[str] = "hertz"
    units: ClassVar[dict[str, str]] = {"m": "power_stiffness", "n": "fraction"}
    meanings: ClassVar[dict[str, str]] = {
        "m": "force at a depth of 1, before anything relaxes",
        "n": "the force grows with this power of depth",
    }
    law: ClassVar[str] = "F(δ) = m δ^n, a power law"
    reference: ClassVar[str] = "Hertz 1882, doi:10.1515/crll.1882.92.156"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """N within a factor 1.3 (one sd) of 3/2, m within 5 of what gives the force at n = 3/2."""
        return cls(lognormal(scales.force / scales.depth**1.5, 5.0), lognormal(1.5, 1.3))

    def force(self, depth: Array) -> Array:
        """F_e = m depth^n, odd in depth."""
        size = jnp.abs(depth)
        inside = jnp.where(size > 0.0, size, 1.0)
        return jnp.where(size > 0.0, self.m * jnp.sign(depth) * inside**self.n, 0.0)

    def stiffness(self, depth: Array) -> Array:
        """K = m n depth^(n-1)."""
        size = jnp.abs(depth)
        inside = jnp.where(size > 0.0, size, 1.0)
        return jnp.where(size > 0.0, self.m * self.n * inside ** (self.n - 1.0), 0.0)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Force quadratic over the step (both ends and the middle), Prony exponential exact."""
        middle = self.force(0.5 * (start + stop))
        return quadratic_force_step(force_start, middle, force_stop, decay)
