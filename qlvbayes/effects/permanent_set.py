"""Define permanent set: the pad's surface does not come back after it was pressed."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import largest
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class PermanentSet(AbstractEffect):
    """Permanent set of the pad's surface: depth = max(d - share dmax, 0).

    dmax is the largest d so far in the test, also while loading.

    * ``share``: share of the largest depth that does not come back, zero or more.
    """

    share: Constant
    name: ClassVar[str] = "permanent_set"
    level: ClassVar[Level] = Level.DEPTH
    units: ClassVar[dict[str, str]] = {"share": "fraction"}
    null: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "delta -> max(delta - share delta_max, 0)"
    seen: ClassVar[str] = "contact is lost early when the platen retracts"
    reference: ClassVar[str] = "Dorfmann & Ogden 2004, doi:10.1016/j.ijsolstr.2003.11.014"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a share scaled by the stiffness at the largest force."""
        return cls(scales.positive(scales.stiffness * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force at the lowered depth."""
        deepest = xp.maximum(largest(motion.displacement, motion.ago), 0.0)
        kept = self._speed_ratio(motion, deepest)
        slowed = replace(
            motion, velocity=motion.velocity * kept, acceleration=motion.acceleration * kept
        )
        return below.force(at_depth(slowed, motion.displacement - self.share * deepest))

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the largest depth."""
        deepest = xp.maximum(displacement, 0.0)
        return below.begin(xp.maximum(displacement - self.share * deepest, 0.0)), deepest

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force at the lowered depth."""
        inner, deepest = state
        deepest = xp.maximum(deepest, line.displacement)
        slowed = replace(line, velocity=line.velocity * self._speed_ratio(line, deepest))
        lowered = line_at_depth(slowed, line.displacement - self.share * deepest)
        inner, force = below.step(inner, lowered)
        return (inner, deepest), force

    def _speed_ratio(self, moved: Motion | Line, deepest: Array) -> Array:
        """Return the specimen's speed over the platen's."""
        growing = (moved.displacement >= deepest) & (moved.velocity > 0.0)
        return xp.where(growing, 1.0 - self.share, 1.0)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: it needs a test that moves back."""
        return None if protocol.unloads else "no test unloads"
