"""Define the exponential elastic law."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.laws.smoothmath import exp_growth
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Exponential(AbstractElastic):
    """Stiffness exponential in depth: F_e = (m/b)(e^{b delta} - 1), the paper's Eq. 8.

    At b = 0 the law is linear, F_e = m delta.

    Parameters
    ----------
    m
        Stiffness at first contact (N/mm).
    b
        Growth of the logarithm of stiffness with depth (1/mm).

    References
    ----------
    Fung 1967, doi:10.1152/ajplegacy.1967.213.6.1532
    """

    m: Constant
    b: Constant
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
        """Return the law under weak priors: m near the secant stiffness, b near 1/depth."""
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        return cls(stiffness, lognormal(1.0 / scales.depth, 5.0))

    def force(self, depth: Array) -> Array:
        """Return F_e = (m/b)(e^{b depth} - 1)."""
        return self.m * exp_growth(depth, self.b)

    def stiffness(self, depth: Array) -> Array:
        """Return K = m e^{b depth}."""
        return self.m * xp.exp(self.b * depth)

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        """Return dd K(d0) e^{b dd s}."""
        travel = stop - start
        begun, ended = self.m + self.b * force_start, self.m + self.b * force_stop
        return Rise((), (self.b * travel, travel * begun, travel * ended))
