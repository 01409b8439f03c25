"""Define strain-dependent rate: relaxation runs faster or slower with depth."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import material_duration, material_time
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


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
