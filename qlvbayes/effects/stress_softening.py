"""Softer below the largest depth so far."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import largest
from qlvbayes.law import Law
from qlvbayes.motion import Motion
from qlvbayes.scales import Scales


class StressSoftening(AbstractEffect):
    """F = F_below (1 - s (1 - d/dmax)), dmax the largest depth so far in the test.

    s: how far the force falls short when the pad is nearly unloaded, zero or more.
    """

    s: Any
    name: ClassVar[str] = "stress_softening"
    level: ClassVar[Level] = Level.SCALING
    units: ClassVar[dict[str, str]] = {"s": "fraction"}
    null: ClassVar[dict[str, float]] = {"s": 0.0}
    law: ClassVar[str] = "F -> F (1 - s (1 - delta/delta_max))"
    seen: ClassVar[str] = "too little force after moving back, right on the way in"
    reference: ClassVar[str] = "Ogden & Roxburgh 1999, doi:10.1098/rspa.1999.0431"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """S scaled by a tenth of the peak force, which keeps it below 1, as more has no meaning."""
        return cls(scales.positive(0.1 * scales.force))

    def force(self, below: Law, motion: Motion) -> Array:
        """Soften below the largest depth."""
        deepest = largest(motion.displacement, motion.ago)
        pressed = deepest > 0.0
        slack = 1.0 - motion.displacement / jnp.where(pressed, deepest, 1.0)
        return below.force(motion) * (1.0 - self.s * jnp.where(pressed, slack, 0.0))

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """It needs a test that moves back."""
        return None if protocol.unloads else "no test unloads"
