"""The pad's surface stays behind after it was pressed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import largest
from qlvbayes.law import Law, at_depth
from qlvbayes.motion import Motion
from qlvbayes.scales import Scales


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
        growing = (motion.displacement >= deepest) & (motion.velocity > 0.0)
        kept = jnp.where(growing, 1.0 - self.share, 1.0)
        slowed = replace(
            motion, velocity=motion.velocity * kept, acceleration=motion.acceleration * kept
        )
        return below.force(at_depth(slowed, motion.displacement - self.share * deepest))

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """It needs a test that moves back."""
        return None if protocol.unloads else "no test unloads"
