"""Define contact offset: contact begins before or after the displacement's zero."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_REST = 1e5  # s at zero displacement before the test
BEFORE = 2
"""Number of points that `rested` adds before a motion."""


class ContactOffset(AbstractEffect):
    """Contact that begins at another displacement: depth = max(displacement - gap, 0).

    A pad with a negative gap has rested at the depth -gap for long when its test begins.

    * ``gap``: displacement at which contact begins (mm), of either sign.
    """

    gap: Constant
    name: ClassVar[str] = "contact_offset"
    level: ClassVar[Level] = Level.DEPTH
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"gap": "displacement"}
    null: ClassVar[dict[str, float]] = {"gap": 0.0}
    law: ClassVar[str] = "delta -> max(delta - gap, 0)"
    seen: ClassVar[str] = "the toe of every ramp comes late, or a force stands before it"
    reference: ClassVar[str] = "Lin, Dimitriadis & Horkay 2007, doi:10.1115/1.2800826"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a gap scaled by the stiffness at the largest force."""
        return cls(scales.signed(scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath at the shifted depth."""
        known = rested(motion)
        return below.force(at_depth(known, known.displacement - self.gap))[BEFORE:]

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath after a long rest and a jump."""
        return begun_rested(self, below, xp.zeros_like(displacement) - self.gap, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force of the law beneath at the shifted depth."""
        return below.step(state, line_at_depth(line, line.displacement - self.gap))


def begun_rested(effect: AbstractEffect, below: Law, depth: Array, displacement: Array) -> State:
    """Return the state after a long rest at zero displacement, at the depth ``depth`` (mm)."""
    zero = xp.zeros_like(displacement)
    state = below.begin(xp.maximum(depth, 0.0))
    state, _ = effect.step(below, state, Line(zero + _REST, zero, zero))
    return effect.step(below, state, Line(zero, displacement, zero))[0]


def rested(motion: Motion) -> Motion:
    """Return the motion after a long rest at zero displacement and a jump to its first point."""
    rest, first = np.zeros(BEFORE), motion.time[:1]
    ago = motion.ago
    return replace(
        motion,
        time=xp.concatenate([first - _REST, first, motion.time]),
        displacement=xp.concatenate([rest, motion.displacement]),
        velocity=xp.concatenate([rest, motion.velocity]),
        acceleration=xp.concatenate([rest, motion.acceleration]),
        ago=None if ago is None else xp.concatenate([ago[:1]] * BEFORE + [ago]),
        sagitta=None if motion.sagitta is None else xp.concatenate([rest, motion.sagitta]),
    )
