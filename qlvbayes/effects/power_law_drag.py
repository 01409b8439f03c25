"""Define power-law drag, which is proportional to a power of the speed."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_POWERS = (0.1, 0.8)
"""Bounds of n. Grease and polymer melts thin with 0.2 to 0.7; at 0.9 it is viscous_drag.

After the constants of a pad have taken their part, 14 % of its force at 0.8 is not viscous drag's,
and 7 % at 0.9. Towards 0 it stays apart from friction, which does not end in a hold.
"""


class PowerLawDrag(AbstractEffect):
    """Drag that grows more slowly than speed: F = F_below + k abs(v)^n sgn v, v in mm/s.

    * ``k``: drag at 1 mm/s (N (s/mm)^n), zero or more.
    * ``n``: exponent, above 0 and below 1, where 1 is viscous drag.
    """

    k: Constant
    n: Constant
    name: ClassVar[str] = "power_law_drag"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"k": "power_drag", "n": "fraction"}
    null: ClassVar[dict[str, float]] = {"k": 0.0}
    law: ClassVar[str] = "F += k |v|^n sgn v"
    seen: ClassVar[str] = "steps of the force at each start and stop that grow slowly with speed"
    needs: ClassVar[str] = "velocity"
    reference: ClassVar[str] = "Herschel & Bulkley 1926, doi:10.1007/BF01432034"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with k scaled by the top speed to the middle exponent."""
        speed = scales.speed if scales.speed > 0.0 else 1.0
        return cls(scales.positive(speed**0.55), Uniform(*_POWERS))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the drag added; at rest the drag and its slopes are 0."""
        return below.force(motion) + self._drag(motion.velocity)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the drag added."""
        state, force = below.step(state, line)
        return state, force + self._drag(line.velocity)

    def _drag(self, velocity: Array) -> Array:
        speed = xp.abs(velocity)
        moving = speed > 0.0
        size = xp.where(moving, speed, 1.0) ** self.n
        return self.k * xp.where(moving, xp.sign(velocity) * size, 0.0)
