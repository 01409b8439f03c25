"""Define levelling drift: the load cell's zero drifts less and less."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.clock import AbstractClocked
from qlvbayes.effects.effect import Level
from qlvbayes.effects.force_drift import ForceDrift
from qlvbayes.effects.spans import duration
from qlvbayes.laws.scales import Scales
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.priors import HalfNormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_LEVELS = 4.0  # prior sd of the slowing over one over the study's duration: it may level off within
_REACHED = 0.3  # share of rate x duration that the drift reaches at the slowing's median


class LevellingDrift(AbstractClocked):
    """Drift of the load cell that levels off: F = F_below + rate (1 - e^{-slowing t})/slowing.

    t is the pad's clock.

    * ``rate``: drift of the cell's zero at first (N/s), of either sign.
    * ``slowing``: rate at which the drift dies out (1/s), zero or more.
    """

    rate: Constant
    slowing: Constant
    name: ClassVar[str] = "levelling_drift"
    level: ClassVar[Level] = ForceDrift.level
    rank: ClassVar[int] = ForceDrift.rank
    units: ClassVar[dict[str, str]] = {"rate": "force_rate", "slowing": "rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    off_pad: ClassVar[bool] = True
    generalises: ClassVar[str] = ForceDrift.name
    reduces: ClassVar[dict[str, float]] = {"slowing": 0.0}
    law: ClassVar[str] = "F += rate (1 - e^(-slowing t))/slowing"
    seen: ClassVar[str] = "a shift of all forces that grows from test to test, the later the less"
    reference: ClassVar[str] = "ISO 376:2011, creep and drift of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the shift at the end of the study."""
        whole = duration(scales)
        return cls(scales.signed(_REACHED * whole), HalfNormal(_LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, shifted with the clock."""
        return force + self.rate * clock * exp_slope(-self.slowing * clock)
