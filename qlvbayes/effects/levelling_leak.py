"""Define levelling leak: fluid leaks out and back, and the pad weakens less and less."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.clock import AbstractClocked
from qlvbayes.effects.effect import Level
from qlvbayes.effects.fluid_leak import FluidLeak
from qlvbayes.effects.spans import duration
from qlvbayes.laws.scales import Scales
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.priors import HalfNormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_LEVELS = 4.0  # prior sd of the return rate over one over the study's duration: it may level off
_REACHED = 0.3  # share of rate x duration that is lost in the end at the median of that rate


class LevellingLeak(AbstractClocked):
    """Leak that levels off: F = F_below w, dw/dt = -rate w + back (1 - w), w(0) = 1.

    t is the pad's clock. Solved, w = 1 - rate (1 - e^{-(rate + back) t})/(rate + back), which
    levels off at back/(rate + back).

    * ``rate``: share of the force lost per second at first (1/s), zero or more.
    * ``back``: share of the loss that returns per second (1/s), zero or more.
    """

    rate: Constant
    back: Constant
    name: ClassVar[str] = "levelling_leak"
    level: ClassVar[Level] = FluidLeak.level
    rank: ClassVar[int] = FluidLeak.rank
    units: ClassVar[dict[str, str]] = {"rate": "rate", "back": "rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    generalises: ClassVar[str] = FluidLeak.name
    reduces: ClassVar[dict[str, float]] = {"back": 0.0}
    law: ClassVar[str] = "F -> F w, dw/dt = -rate w + back (1 - w)"
    seen: ClassVar[str] = "each test weaker than the one before, the later the less"
    reference: ClassVar[str] = "Biot 1941, doi:10.1063/1.1712886"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the loss at the end of the study."""
        # of tests at even intervals one that levels off within the study is conditioning to 0.998,
        # by the clock in place of the count: only a pause or one long test tells the two apart
        whole = duration(scales)
        return cls(scales.positive(_REACHED * scales.force * whole), HalfNormal(_LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, weakened with the clock."""
        lost = self.rate * clock * exp_slope(-(self.rate + self.back) * clock)
        return force * (1.0 - lost)
