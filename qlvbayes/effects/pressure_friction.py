"""Dry friction that grows with the force pressed."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.friction import Friction, slide, slide_step, unslid
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import Uniform


class PressureFriction(AbstractEffect):
    """F = F_below + strength (1 - share + share max(F_below, 0)/pressed) z, z as in friction.

    strength: force of steady sliding where the pad presses with ``pressed`` (N), zero or more;
    reach: the way over which it turns round (mm); share: of the friction that goes with the force,
    from 0 to 1, where it is Coulomb's with the coefficient strength/pressed; pressed (N): fixed.
    """

    strength: Any
    reach: Any
    share: Any
    pressed: Any
    name: ClassVar[str] = "pressure_friction"
    level: ClassVar[Level] = Friction.level
    rank: ClassVar[int] = Friction.rank
    units: ClassVar[dict[str, str]] = {
        "strength": "force",
        "reach": "displacement",
        "share": "fraction",
        "pressed": "force",
    }
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    generalises: ClassVar[str] = Friction.name
    reduces: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "F += strength (1 - share + share F/pressed) z"
    seen: ClassVar[str] = "a force against the motion, at any speed, larger the harder it presses"
    reference: ClassVar[str] = "Amontons 1699; Derjaguin 1934, Z. Phys. 88"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Strength scaled by the peak force, at which it is told; any share alike."""
        return cls(
            scales.positive(1.0),
            lognormal(0.03 * scales.depth, 2.0),
            Uniform(0.0, 1.0),
            scales.force,
        )

    def force(self, below: Law, motion: Motion) -> Array:
        """Add the friction."""
        return self._rubbed(below.force(motion), slide(motion, self.reach))

    def begin(self, below: Law, displacement: Array) -> State:
        """Beside the law's state that of friction, none."""
        return below.begin(displacement), unslid(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Add the friction."""
        inner, own = state
        inner, force = below.step(inner, line)
        own, slid = slide_step(own, line, self.reach)
        return (inner, own), self._rubbed(force, slid)

    def _rubbed(self, force: Array, slid: Array) -> Array:
        grown = 1.0 + self.share * (jnp.maximum(force, 0.0) / self.pressed - 1.0)
        return force + self.strength * grown * slid
