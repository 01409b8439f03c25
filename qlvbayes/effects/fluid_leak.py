"""Define fluid leak: fluid is lost for good, and the pad weakens from test to test."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.clock import AbstractClocked
from qlvbayes.effects.effect import Level
from qlvbayes.effects.spans import duration
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class FluidLeak(AbstractClocked):
    """Weakening by a leak: F = F_below e^{-rate t}, t since the pad's first test began.

    * ``rate``: share of the force lost per second (1/s), zero or more.
    """

    rate: Constant
    name: ClassVar[str] = "fluid_leak"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"rate": "rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    law: ClassVar[str] = "F -> F e^(-rate t)"
    seen: ClassVar[str] = "each test weaker than the one before, all along it"
    reference: ClassVar[str] = "Darcy 1856; Biot 1941, doi:10.1063/1.1712886"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the peak force and the study's duration."""
        return cls(scales.positive(scales.force * duration(scales)))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, weakened with the clock."""
        return force * xp.exp(-self.rate * clock)
