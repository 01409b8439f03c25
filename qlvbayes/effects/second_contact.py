"""Define second contact: a void closes, or a backing is reached."""

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

_RANGE = (
    0.1,
    0.95,
)  # shares of the largest depth: nearer to its ends it is another elastic law, or not visible


class SecondContact(AbstractEffect):
    """Second spring beyond a depth: F = F_below + stiffness max(d - depth, 0).

    The second spring does not relax.

    * ``stiffness``: its stiffness (N/mm), zero or more.
    * ``depth``: depth at which it is reached (mm).
    """

    stiffness: Constant
    depth: Constant
    name: ClassVar[str] = "second_contact"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 5
    units: ClassVar[dict[str, str]] = {"stiffness": "stiffness", "depth": "displacement"}
    null: ClassVar[dict[str, float]] = {"stiffness": 0.0}
    law: ClassVar[str] = "F += stiffness max(delta - depth, 0)"
    seen: ClassVar[str] = "stiffer at once beyond a depth, at any speed, also after long holds"
    reference: ClassVar[str] = "Gibson & Ashby 1997, Cellular Solids, ch. 5, densification"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a stiffness scaled by half of the depth."""
        low, high = (share * scales.depth for share in _RANGE)
        return cls(scales.positive(0.5 * scales.depth), Uniform(low, high))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the second spring added."""
        return below.force(motion) + self._spring(motion.displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the second spring added."""
        state, force = below.step(state, line)
        return state, force + self._spring(line.displacement)

    def _spring(self, depth: Array) -> Array:
        return self.stiffness * xp.maximum(depth - self.depth, 0.0)
