"""How much relaxes depends on the depth."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales


class StrainDependentStrength(AbstractEffect):
    """F = (1 - s) F_below + s F_e(d) with s = 1 - e^{-beta d}, F_e the instantaneous elastic force.

    beta: how depth takes away from the share that relaxes (1/mm), of either sign.
    """

    beta: Any
    name: ClassVar[str] = "strain_dependent_strength"
    level: ClassVar[Level] = Level.MATERIAL
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {"beta": "exponent"}
    null: ClassVar[dict[str, float]] = {"beta": 0.0}
    law: ClassVar[str] = "F -> e^(-beta delta) F + (1 - e^(-beta delta)) F_e"
    seen: ClassVar[str] = "holds at different depths lose different shares of their force"
    reference: ClassVar[str] = "Provenzano et al. 2001, doi:10.1114/1.1408926"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Beta scaled by the depth and the part of the peak force that relaxes."""
        return cls(scales.signed(0.7 * scales.force * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        """Mix in the elastic force."""
        return self._mixed(below, below.force(motion), motion.displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Mix in the elastic force."""
        state, force = below.step(state, line)
        return state, self._mixed(below, force, line.displacement)

    def _mixed(self, below: Law, force: Array, depth: Array) -> Array:
        share = -jnp.expm1(-self.beta * depth)
        return force + share * (below.elastic.force(depth) - force)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """It needs holds at two depths: at one alone the relaxation's constants do what it does."""
        return "all holds are at one depth" if protocol.one_depth else None
