"""Define backlash: there is play between the encoder and the platen."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import confined
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Backlash(AbstractEffect):
    """Play of the drive when it turns: the depth is p = min(max(p_before, d), d + play).

    On the way in the platen is where the encoder says. This is the play operator.

    * ``play``: distance that the drive moves back before the platen follows (mm), zero or more.
    """

    play: Constant
    name: ClassVar[str] = "backlash"
    level: ClassVar[Level] = Level.DEPTH
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {"play": "displacement"}
    null: ClassVar[dict[str, float]] = {"play": 0.0}
    inverts: ClassVar[bool] = False
    not_inverted: ClassVar[str] = "while the platen waits the drive may be anywhere in the play"
    law: ClassVar[str] = "delta -> p, p' = 0 until delta leaves [p - play, p]"
    seen: ClassVar[str] = "after each turn of the drive the force waits before it follows"
    reference: ClassVar[str] = "Visintin 1994, doi:10.1007/978-3-662-11557-2, ch. III, play"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a play scaled by the stiffness at the largest force."""
        return cls(scales.positive(scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath at the platen's own depth."""
        depth, _ = xp.accumulate(confined, self._range(motion.displacement))
        waits = self._waits(depth, motion.displacement)
        still = xp.zeros_like(depth)
        followed = replace(
            motion,
            displacement=depth,
            velocity=xp.where(waits, still, motion.velocity),
            acceleration=xp.where(waits, still, motion.acceleration),
            sagitta=None if motion.sagitta is None else xp.where(waits, still, motion.sagitta),
        )
        return below.force(followed)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the platen's depth."""
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force after a line on which the platen waits, then follows."""
        inner, depth = state
        depth = xp.clip(depth, line.displacement, line.displacement + self.play)
        waits = self._waits(depth, line.displacement)
        speed = xp.where(waits, 0.0, line.velocity)
        inner, force = below.step(inner, replace(line, displacement=depth, velocity=speed))
        return (inner, depth), force

    def _range(self, displacement: Array) -> tuple[Array, Array]:
        """Return the least and the largest depth (N,) of the platen at each point."""
        return displacement, xp.concatenate([displacement[:1], displacement[1:] + self.play])

    def _waits(self, depth: Array, displacement: Array) -> Array:
        """Return whether the platen is inside the play, in contact with neither of its ends."""
        # exact: a platen at one end of the play was set to that very number
        return (depth > displacement) & (depth < displacement + self.play)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: it needs a test that moves back."""
        return None if protocol.unloads else "no test unloads"
