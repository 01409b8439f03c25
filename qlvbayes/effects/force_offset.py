"""Define force offset: the load cell's zero is off."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class ForceOffset(AbstractEffect):
    """Offset of all forces: F = F_below + offset.

    * ``offset``: reading of the unloaded cell (N), of either sign.
    """

    offset: Constant
    name: ClassVar[str] = "force_offset"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"offset": "force"}
    null: ClassVar[dict[str, float]] = {"offset": 0.0}
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += offset"
    seen: ClassVar[str] = "all forces shifted alike, those without contact too"
    reference: ClassVar[str] = "ISO 376:2011, zero of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with an offset scaled by the peak force."""
        return cls(scales.signed(1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the shifted force."""
        return below.force(motion) + self.offset

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the shifted force."""
        state, force = below.step(state, line)
        return state, force + self.offset
