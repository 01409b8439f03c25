"""Changes of the relaxation: one more mode, rates or strengths that depend on strain."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, AbstractPointwise, Level, Protocol
from qlvbayes.effects.history import material_duration, material_time, resolved_rates
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Spectrum
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class ExtraRelaxationMode(AbstractEffect):
    """Further relaxation mode: G -> (1 - c) G + c e^{-v t}, so F = (1 - c) F_below + c F_mode."""

    c: Constant = constant("fraction", "the mode's share, zero or more")
    v: Constant = constant("rate", "its rate")
    name: ClassVar[str] = "extra_relaxation_mode"
    level: ClassVar[Level] = Level.MATERIAL
    law: ClassVar[str] = "G -> (1 - c) G + c e^(-v t)"
    seen: ClassVar[str] = "holds decay at one more rate, quicker or slower than the others"
    reference: ClassVar[str] = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # at most a fifth of a sample's: a quicker mode is a drag that grows with the stiffness, as
        # a squeeze film's does (a cosine of 0.96 there)
        low, high = resolved_rates(scales)
        return cls(scales.positive(0.6 * scales.force), LogUniform(low, high))

    def force(self, below: Law, motion: Motion) -> Array:
        return self._with_mode(below).force(motion)

    def spectrum(self, fractions: Array, rates: Array) -> tuple[Array, Array]:
        share, rate = xp.asarray(self.c)[None], xp.asarray(self.v)[None]
        return (
            xp.concatenate([(1.0 - self.c) * fractions, share]),
            xp.concatenate([rates, rate]),
        )

    def begin(self, below: Law, displacement: Array) -> State:
        return self._with_mode(below).begin(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        return self._with_mode(below).step(state, line)

    def _with_mode(self, below: Law) -> Law:
        relaxation = Spectrum(*self.spectrum(*below.relaxation.spectrum()))
        return Law(below.elastic, relaxation, below.layers)


class StrainDependentRate(AbstractEffect):
    """Rates of relaxation that change with depth: v_i -> v_i e^{alpha d}.

    All modes then relax in the material time xi = int e^{alpha d} dt.
    """

    alpha: Constant = constant("exponent", "how depth speeds up relaxation, of either sign")
    name: ClassVar[str] = "strain_dependent_rate"
    level: ClassVar[Level] = Level.MATERIAL
    rank: ClassVar[int] = 1
    law: ClassVar[str] = "v_i -> v_i e^(alpha delta)"
    seen: ClassVar[str] = "holds at different depths decay at different rates"
    reference: ClassVar[str] = "Schapery 1969, doi:10.1002/pen.760090410"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(0.2 * scales.force * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        xi = material_time(motion.time, motion.displacement, self.alpha)
        return below.force(replace(motion, time=xi))

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, depth = state
        xi_step = material_duration(line.duration, depth, line.displacement, self.alpha)
        inner, force = below.step(inner, replace(line, duration=xi_step))
        return (inner, line.displacement), force


class StrainDependentStrength(AbstractPointwise):
    """Relaxing share that changes with depth: F = (1 - s) F_below + s F_e(d), s = 1 - e^{-beta d}.

    F_e is the instantaneous elastic force.
    """

    beta: Constant = constant(
        "exponent", "how depth lessens the share that relaxes, of either sign"
    )
    name: ClassVar[str] = "strain_dependent_strength"
    level: ClassVar[Level] = Level.MATERIAL
    rank: ClassVar[int] = 2
    law: ClassVar[str] = "F -> e^(-beta delta) F + (1 - e^(-beta delta)) F_e"
    seen: ClassVar[str] = "holds at different depths lose different shares of their force"
    reference: ClassVar[str] = "Provenzano et al. 2001, doi:10.1114/1.1408926"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(0.7 * scales.force * scales.depth))

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        share = -xp.expm1(-self.beta * now.displacement)
        return force + share * (below.elastic.force(now.displacement) - force)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return "all holds are at one depth" if protocol.one_depth else None
