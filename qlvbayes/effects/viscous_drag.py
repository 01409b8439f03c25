"""Define viscous drag, which is proportional to speed."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class ViscousDrag(AbstractEffect):
    """Drag proportional to speed: F = F_below + eta v, v the velocity of the pad's surface.

    * ``eta``: drag coefficient (N s/mm), zero or more.
    """

    eta: Constant
    name: ClassVar[str] = "viscous_drag"
    level: ClassVar[Level] = Level.ADDING
    units: ClassVar[dict[str, str]] = {"eta": "drag"}
    null: ClassVar[dict[str, float]] = {"eta": 0.0}
    law: ClassVar[str] = "F += eta v"
    seen: ClassVar[str] = "steps of the force at each start and stop, proportional to speed"
    needs: ClassVar[str] = "velocity"
    reference: ClassVar[str] = "Kelvin & Voigt; Findley, Lai & Onaran 1976, ch. 5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with eta scaled by the top speed."""
        return cls(scales.positive(scales.speed if scales.speed > 0.0 else 1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with eta v added."""
        return below.force(motion) + self.eta * motion.velocity

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with eta v added."""
        state, force = below.step(state, line)
        return state, force + self.eta * line.velocity
