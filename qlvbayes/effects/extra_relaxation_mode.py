"""One more Prony term."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.spans import resolved_rates
from qlvbayes.laws.hereditary import at_first, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform


class ExtraRelaxationMode(AbstractEffect):
    """G -> (1 - c) G + c e^{-v t}, so F = (1 - c) F_below + c F_mode.

    c: the mode's share, zero or more; v: its rate (1/s).
    """

    c: Any
    v: Any
    name: ClassVar[str] = "extra_relaxation_mode"
    level: ClassVar[Level] = Level.MATERIAL
    units: ClassVar[dict[str, str]] = {"c": "fraction", "v": "rate"}
    null: ClassVar[dict[str, float]] = {"c": 0.0}
    law: ClassVar[str] = "G -> (1 - c) G + c e^(-v t)"
    seen: ClassVar[str] = "holds decay at one more rate, quicker or slower than the others"
    reference: ClassVar[str] = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Share scaled by 0.6 of the peak force; rates that the tests can resolve."""
        low, high = resolved_rates(scales)
        return cls(scales.positive(0.6 * scales.force), LogUniform(low, high))

    def force(self, below: Law, motion: Motion) -> Array:
        """Mix in the mode."""
        extra = hereditary_force(
            below.elastic, self._mode, motion.time, motion.displacement, motion.bow
        )
        return (1.0 - self.c) * below.force(motion) + self.c * extra

    def relaxed(self, relaxation: Array, time: Array) -> Array:
        """The law itself, G -> (1 - c) G + c e^(-v t)."""
        return (1.0 - self.c) * relaxation + self.c * jnp.exp(-self.v * time)

    def begin(self, below: Law, displacement: Array) -> State:
        """Beside the law's state, the mode's."""
        return below.begin(displacement), at_first(below.elastic, self._mode, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Mix in the mode."""
        inner, own = state
        inner, force = below.step(inner, line)
        own, extra = hereditary_step(
            below.elastic, self._mode, own, line.duration, line.displacement
        )
        return (inner, own), (1.0 - self.c) * force + self.c * extra

    @property
    def _mode(self) -> Prony:
        return Prony(jnp.array([0.0, 1.0]), jnp.reshape(self.v, (1,)))
