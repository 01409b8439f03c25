"""Define the linear elastic law."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


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
        return self.m * xp.ones_like(depth)

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        """Return m dd."""
        return Rise((self.m * (stop - start),))
