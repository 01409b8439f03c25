"""Define gradual contact, which makes a rounded toe."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.contact_offset import BEFORE, ContactOffset, begun_rested, rested
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class GradualContact(AbstractEffect):
    """Contact that is made gradually: depth = max(d - gap (1 - e^{-d/over}), 0).

    In the exponent d is max(displacement, 0). At over = 0 a pad with a negative gap has rested, as
    in contact_offset.

    * ``gap``: how far the depth falls short once contact is full (mm), of either sign.
    * ``over``: depth over which contact is made (mm), zero or more.
    """

    gap: Constant
    over: Constant
    name: ClassVar[str] = "gradual_contact"
    level: ClassVar[Level] = ContactOffset.level
    rank: ClassVar[int] = ContactOffset.rank
    units: ClassVar[dict[str, str]] = {"gap": "displacement", "over": "displacement"}
    null: ClassVar[dict[str, float]] = {"gap": 0.0}
    generalises: ClassVar[str] = ContactOffset.name
    reduces: ClassVar[dict[str, float]] = {"over": 0.0}
    law: ClassVar[str] = "delta -> max(delta - gap (1 - e^(-delta/over)), 0)"
    seen: ClassVar[str] = "the toe of every ramp is longer and rounder, or shorter"
    reference: ClassVar[str] = "Fung 1993, Biomechanics, ch. 7.3, the toe region"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a gap scaled by the stiffness at the largest force."""
        return cls(scales.signed(scales.stiffness), lognormal(0.1 * scales.depth, 3.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath at the changed depth, speed and acceleration."""
        known = rested(motion)
        depth, slope, over = self._contact_depth(known.displacement)
        changed = replace(
            known,
            velocity=known.velocity * (1.0 - slope),
            acceleration=known.acceleration * (1.0 - slope) + known.velocity**2 * slope / over,
        )
        return below.force(at_depth(changed, depth))[BEFORE:]

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath after a long rest and a jump."""
        depth, _, _ = self._contact_depth(xp.zeros_like(displacement))
        return begun_rested(self, below, depth, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force of the law beneath at the changed depth and speed."""
        depth, slope, _ = self._contact_depth(line.displacement)
        changed = replace(line, velocity=line.velocity * (1.0 - slope))
        return below.step(state, line_at_depth(changed, depth))

    def _contact_depth(self, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the depth (may be below 0), the relative loss of speed, and ``over`` (mm)."""
        gradual = self.over > 0.0
        over = xp.where(gradual, self.over, 1.0)
        missing = xp.exp(-xp.maximum(displacement, 0.0) / over)
        missing = xp.where(gradual, missing, 0.0)
        slope = xp.where(displacement > 0.0, self.gap / over * missing, 0.0)
        return displacement - self.gap * (1.0 - missing), slope, over
