"""The rig gives way to force, the less the larger it is."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.frame_compliance import (
    FrameCompliance,
    balanced,
    balanced_begin,
    balanced_step,
)
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal


class StiffeningFrame(AbstractEffect):
    """Depth = displacement - compliance F/(1 + abs(F)/stiff), F the force itself.

    compliance: of the unloaded frame (mm/N), zero or more; stiff: force at which it has given way
    half as far as it would have (N). Solved as for a frame that does not stiffen.
    """

    compliance: Any
    stiff: Any
    name: ClassVar[str] = "stiffening_frame"
    level: ClassVar[Level] = FrameCompliance.level
    rank: ClassVar[int] = FrameCompliance.rank
    units: ClassVar[dict[str, str]] = {"compliance": "compliance", "stiff": "force"}
    null: ClassVar[dict[str, float]] = {"compliance": 0.0}
    costly: ClassVar[bool] = True
    generalises: ClassVar[str] = FrameCompliance.name
    reduces: ClassVar[dict[str, float]] = {"stiff": math.inf}
    law: ClassVar[str] = "delta -> delta - compliance F/(1 + |F|/stiff)"
    seen: ClassVar[str] = "softer where the force is small, less so where it is large"
    reference: ClassVar[str] = "Kalidindi, Abusafieh & El-Danaf 1997, Exp. Mech. 37"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Compliance scaled as that of a frame half as soft at the peak force."""
        return cls(scales.positive(scales.force**2 / scales.depth), lognormal(scales.force, 3.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Iterate F = below(displacement - deflection)."""
        return balanced(below, motion, self._yielding)

    def begin(self, below: Law, displacement: Array) -> State:
        """A state of the law for each of Newton's steps."""
        return balanced_begin(below, displacement, self._yielding)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Iterate F = below(displacement - deflection)."""
        return balanced_step(below, state, line, self._yielding)

    def _yielding(self, force: Array) -> tuple[Array, Array]:
        softness = 1.0 / (1.0 + jnp.abs(force) / self.stiff)
        return self.compliance * softness * force, self.compliance * softness**2
