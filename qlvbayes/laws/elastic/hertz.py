"""Define the elastic law of Hertz's contact, and of other powers of depth."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class HertzPower(AbstractElastic):
    """Elastic force as a power of depth: F_e = m delta^n.

    A sphere on a flat has n = 3/2 (Hertz). The force is odd in the depth. The hereditary step has
    no closed form: the exponential of each relaxation mode is integrated exactly against a force
    that is quadratic over the step, with an error that falls at least as the square of the step.

    Parameters
    ----------
    m
        Force at a depth of 1 mm (N/mm^n).
    n
        Exponent, above 1.

    References
    ----------
    Hertz 1882, doi:10.1515/crll.1882.92.156
    """

    m: Constant
    n: Constant
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
        """Return the law under weak priors: n near 3/2, m near what gives the peak force then."""
        return cls(lognormal(scales.force / scales.depth**1.5, 5.0), lognormal(1.5, 1.3))

    def force(self, depth: Array) -> Array:
        """Return F_e = m depth^n, odd in depth."""
        size = xp.abs(depth)
        inside = xp.where(size > 0.0, size, 1.0)
        return xp.where(size > 0.0, self.m * xp.sign(depth) * inside**self.n, 0.0)

    def stiffness(self, depth: Array) -> Array:
        """Return K = m n depth^(n-1)."""
        size = xp.abs(depth)
        inside = xp.where(size > 0.0, size, 1.0)
        return xp.where(size > 0.0, self.m * self.n * inside ** (self.n - 1.0), 0.0)
