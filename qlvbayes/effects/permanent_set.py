"""The pad's surface stays behind after it was pressed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import largest
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales


class PermanentSet(AbstractEffect):
    """Depth = max(d - share dmax, 0), dmax the largest d so far in the test, also while loading.

    share: of the largest depth that does not come back, zero or more.
    """

    share: Any
    name: ClassVar[str] = "permanent_set"
    level: ClassVar[Level] = Level.DEPTH
    units: ClassVar[dict[str, str]] = {"share": "fraction"}
    null: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "delta -> max(delta - share delta_max, 0)"
    seen: ClassVar[str] = "contact is lost early when the platen retracts"
    reference: ClassVar[str] = "Dorfmann & Ogden 2004, doi:10.1016/j.ijsolstr.2003.11.014"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Share scaled by the stiffness at the largest force."""
        return cls(scales.positive(scales.stiffness * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        """Lower the depth; while it is the largest so far, the set grows with it."""
        deepest = jnp.maximum(largest(motion.displacement, motion.ago), 0.0)
        kept = self._kept(motion, deepest)
        slowed = replace(
            motion, velocity=motion.velocity * kept, acceleration=motion.acceleration * kept
        )
        return below.force(at_depth(slowed, motion.displacement - self.share * deepest))

    def begin(self, below: Law, displacement: Array) -> State:
        """Beside the law's state, the largest depth."""
        deepest = jnp.maximum(displacement, 0.0)
        return below.begin(jnp.maximum(displacement - self.share * deepest, 0.0)), deepest

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Lower the depth."""
        inner, deepest = state
        deepest = jnp.maximum(deepest, line.displacement)
        slowed = replace(line, velocity=line.velocity * self._kept(line, deepest))
        lowered = line_at_depth(slowed, line.displacement - self.share * deepest)
        inner, force = below.step(inner, lowered)
        return (inner, deepest), force

    def _kept(self, moved: Motion | Line, deepest: Array) -> Array:
        """Share of the speed that the specimen has."""
        growing = (moved.displacement >= deepest) & (moved.velocity > 0.0)
        return jnp.where(growing, 1.0 - self.share, 1.0)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """It needs a test that moves back."""
        return None if protocol.unloads else "no test unloads"
