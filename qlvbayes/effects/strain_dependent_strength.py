"""Define strain-dependent strength: how much relaxes depends on depth."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class StrainDependentStrength(AbstractEffect):
    """Relaxing share that changes with depth: F = (1 - s) F_below + s F_e(d), s = 1 - e^{-beta d}.

    F_e is the instantaneous elastic force.

    * ``beta``: how depth lessens the share that relaxes (1/mm), of either sign.
    """

    beta: Constant
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
        """Return the effect with beta scaled by the depth and the relaxing part of the force."""
        return cls(scales.signed(0.7 * scales.force * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the elastic force mixed in."""
        return self._mixed(below, below.force(motion), motion.displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the elastic force mixed in."""
        state, force = below.step(state, line)
        return state, self._mixed(below, force, line.displacement)

    def _mixed(self, below: Law, force: Array, depth: Array) -> Array:
        share = -xp.expm1(-self.beta * depth)
        return force + share * (below.elastic.force(depth) - force)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: it needs holds at two depths."""
        return "all holds are at one depth" if protocol.one_depth else None
