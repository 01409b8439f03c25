"""Define force drift: the load cell's zero drifts."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.clock import AbstractClocked
from qlvbayes.effects.effect import Level
from qlvbayes.effects.spans import duration
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class ForceDrift(AbstractClocked):
    """Drift of the load cell: F = F_below + rate t, t since the pad's first test began.

    * ``rate``: drift of the cell's zero (N/s), of either sign.
    """

    rate: Constant
    name: ClassVar[str] = "force_drift"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {"rate": "force_rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += rate t"
    seen: ClassVar[str] = "a shift of all forces that grows from test to test"
    reference: ClassVar[str] = "ISO 376:2011, creep and drift of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the study's duration."""
        return cls(scales.signed(duration(scales)))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, shifted with the clock."""
        return force + self.rate * clock
