"""Contact begins before or after the displacement's zero."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales

_REST = 1e5  # s at zero displacement before the test
BEFORE = 2
"""Points that `rested` adds."""


class ContactOffset(AbstractEffect):
    """Depth = max(displacement - gap, 0).

    gap (mm): where contact begins; a pad with a negative one has rested at depth -gap for long
    when its test begins.
    """

    gap: Any
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
        """Gap scaled by the stiffness at the largest force."""
        return cls(scales.signed(scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        """Shift the depth."""
        known = rested(motion)
        return below.force(at_depth(known, known.displacement - self.gap))[BEFORE:]

    def begin(self, below: Law, displacement: Array) -> State:
        """The law's own, after a long rest and a jump."""
        return begun_rested(self, below, jnp.zeros_like(displacement) - self.gap, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Shift the depth."""
        return below.step(state, line_at_depth(line, line.displacement - self.gap))


def begun_rested(effect: AbstractEffect, below: Law, depth: Array, displacement: Array) -> State:
    """The state after a long rest at zero displacement, where the specimen's depth is ``depth``."""
    zero = jnp.zeros_like(displacement)
    state = below.begin(jnp.maximum(depth, 0.0))
    state, _ = effect.step(below, state, Line(zero + _REST, zero, zero))
    return effect.step(below, state, Line(zero, displacement, zero))[0]


def rested(motion: Motion) -> Motion:
    """The motion after a long rest at zero displacement, from which it jumps to its first point.

    As a motion without it does, so that a gap of nothing changes nothing.
    """
    rest, first = jnp.zeros(BEFORE), motion.time[:1]
    ago = motion.ago
    return replace(
        motion,
        time=jnp.concatenate([first - _REST, first, motion.time]),
        displacement=jnp.concatenate([rest, motion.displacement]),
        velocity=jnp.concatenate([rest, motion.velocity]),
        acceleration=jnp.concatenate([rest, motion.acceleration]),
        ago=None if ago is None else jnp.concatenate([ago[:1]] * BEFORE + [ago]),
        bow=None if motion.bow is None else jnp.concatenate([rest, motion.bow]),
    )
