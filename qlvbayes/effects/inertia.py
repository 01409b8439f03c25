"""Define the inertia of the mass that moves with the load cell."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Inertia(AbstractEffect):
    """Force that accelerates a mass: F = F_below + mass a, a the platen's acceleration.

    * ``mass``: mass that moves with the load cell (N s2/mm, which is 1000 kg), zero or more.
    """

    mass: Constant
    name: ClassVar[str] = "inertia"
    level: ClassVar[Level] = Level.SENSOR
    units: ClassVar[dict[str, str]] = {"mass": "mass"}
    null: ClassVar[dict[str, float]] = {"mass": 0.0}
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += mass a"
    seen: ClassVar[str] = "pulses of the force while the platen speeds up or brakes"
    needs: ClassVar[str] = "acceleration"
    not_stepped: ClassVar[str] = (
        "straight lines have no acceleration but at their ends, where it has no bound"
    )
    reference: ClassVar[str] = "Newton 1687, second law"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a mass scaled by the largest acceleration."""
        return cls(scales.positive(scales.acceleration if scales.acceleration > 0.0 else 1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with mass times acceleration added."""
        return below.force(motion) + self.mass * motion.acceleration
