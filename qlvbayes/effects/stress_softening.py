"""Define stress softening: the pad is softer below the largest depth so far."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import largest
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class StressSoftening(AbstractEffect):
    """Softening of the pad below its largest depth: F = F_below (1 - s (1 - d/dmax)).

    dmax is the largest depth so far in the test.

    * ``s``: relative loss of force when the pad is nearly unloaded, zero or more.
    """

    s: Constant
    name: ClassVar[str] = "stress_softening"
    level: ClassVar[Level] = Level.SCALING
    units: ClassVar[dict[str, str]] = {"s": "fraction"}
    null: ClassVar[dict[str, float]] = {"s": 0.0}
    law: ClassVar[str] = "F -> F (1 - s (1 - delta/delta_max))"
    seen: ClassVar[str] = "too little force after moving back, right on the way in"
    reference: ClassVar[str] = "Ogden & Roxburgh 1999, doi:10.1098/rspa.1999.0431"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with s scaled by a tenth of the peak force, which keeps s below 1."""
        return cls(scales.positive(0.1 * scales.force))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force, softened below the largest depth."""
        deepest = largest(motion.displacement, motion.ago)
        return below.force(motion) * self._remaining(motion.displacement, deepest)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the largest depth."""
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force, softened below the largest depth."""
        inner, deepest = state
        inner, force = below.step(inner, line)
        deepest = xp.maximum(deepest, line.displacement)
        return (inner, deepest), force * self._remaining(line.displacement, deepest)

    def _remaining(self, depth: Array, deepest: Array) -> Array:
        """Return the share of the force that is left."""
        pressed = deepest > 0.0
        slack = 1.0 - depth / xp.where(pressed, deepest, 1.0)
        return 1.0 - self.s * xp.where(pressed, slack, 0.0)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: it needs a test that moves back."""
        return None if protocol.unloads else "no test unloads"
