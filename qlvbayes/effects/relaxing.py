"""Changes of the relaxation: one more mode, rates or strengths that depend on strain."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import material_duration, material_time, resolved_rates
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Spectrum
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class ExtraRelaxationMode(AbstractEffect):
    """Further relaxation mode: G -> (1 - c) G + c e^{-v t}, so F = (1 - c) F_below + c F_mode.

    * ``c``: the mode's share, zero or more.
    * ``v``: its rate (1/s).
    """

    c: Constant
    v: Constant
    name: ClassVar[str] = "extra_relaxation_mode"
    level: ClassVar[Level] = Level.MATERIAL
    units: ClassVar[dict[str, str]] = {"c": "fraction", "v": "rate"}
    null: ClassVar[dict[str, float]] = {"c": 0.0}
    law: ClassVar[str] = "G -> (1 - c) G + c e^(-v t)"
    seen: ClassVar[str] = "holds decay at one more rate, quicker or slower than the others"
    reference: ClassVar[str] = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a share scaled by 0.6 of the peak force."""
        # at most a fifth of a sample's: a quicker mode is a drag that grows with the stiffness, as
        # a squeeze film's does (a cosine of 0.96 there)
        low, high = resolved_rates(scales)
        return cls(scales.positive(0.6 * scales.force), LogUniform(low, high))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath with one more mode."""
        return self._with_mode(below).force(motion)

    def spectrum(self, fractions: Array, rates: Array) -> tuple[Array, Array]:
        """Return the spectrum with one more mode, G -> (1 - c) G + c e^(-v t)."""
        share, rate = xp.asarray(self.c)[None], xp.asarray(self.v)[None]
        return (
            xp.concatenate([(1.0 - self.c) * fractions, share]),
            xp.concatenate([rates, rate]),
        )

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath with one more mode."""
        return self._with_mode(below).begin(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force of the law beneath with one more mode."""
        return self._with_mode(below).step(state, line)

    def _with_mode(self, below: Law) -> Law:
        relaxation = Spectrum(*self.spectrum(*below.relaxation.spectrum()))
        return Law(below.elastic, relaxation, below.layers)


class StrainDependentRate(AbstractEffect):
    """Rates of relaxation that change with depth: v_i -> v_i e^{alpha d}.

    All modes then relax in the material time xi = int e^{alpha d} dt.

    * ``alpha``: how depth speeds up relaxation (1/mm), of either sign.
    """

    alpha: Constant
    name: ClassVar[str] = "strain_dependent_rate"
    level: ClassVar[Level] = Level.MATERIAL
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"alpha": "exponent"}
    null: ClassVar[dict[str, float]] = {"alpha": 0.0}
    law: ClassVar[str] = "v_i -> v_i e^(alpha delta)"
    seen: ClassVar[str] = "holds at different depths decay at different rates"
    reference: ClassVar[str] = "Schapery 1969, doi:10.1002/pen.760090410"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with alpha scaled by the depth and a fifth of the peak force."""
        return cls(scales.signed(0.2 * scales.force * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force beneath in the material's own time."""
        xi = material_time(motion.time, motion.displacement, self.alpha)
        return below.force(replace(motion, time=xi))

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the depth."""
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force after the line's duration in material time."""
        inner, depth = state
        xi_step = material_duration(line.duration, depth, line.displacement, self.alpha)
        inner, force = below.step(inner, replace(line, duration=xi_step))
        return (inner, line.displacement), force


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
