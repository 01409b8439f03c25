"""Define an extra relaxation mode: one more Prony term."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.spans import resolved_rates
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.spectrum import Spectrum
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
