"""Define fluid pressure, which builds up with compression and drains away."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import fading, material_duration, material_time
from qlvbayes.effects.spans import resolved_times
from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import HalfNormal, LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class FluidPressure(AbstractEffect):
    """Pressure of trapped fluid: F = F_below + p, dp/dt = k v - (p/tau) e^{-a d}, p(0) = 0.

    In the time xi = int e^{-a d} dt this is one relaxing mode.

    * ``k``: undrained stiffness (N/mm), zero or more.
    * ``tau``: time of drainage at zero depth (s).
    * ``a``: how compression closes the pores (1/mm).
    """

    k: Constant
    tau: Constant
    a: Constant
    name: ClassVar[str] = "fluid_pressure"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 3
    units: ClassVar[dict[str, str]] = {"k": "stiffness", "tau": "time", "a": "exponent"}
    null: ClassVar[dict[str, float]] = {"k": 0.0}
    law: ClassVar[str] = "dp/dt = k v - (p/tau) e^(-a delta), F += p"
    seen: ClassVar[str] = "a transient after each move, slower to die the deeper it is"
    reference: ClassVar[str] = "Lai, Mow & Roth 1981, doi:10.1115/1.3138261"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with k scaled by the depth."""
        low, high = resolved_times(scales)
        return cls(
            scales.positive(scales.depth), LogUniform(low, high), HalfNormal(1.0 / scales.depth)
        )

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the pressure added."""
        own = motion.alone
        xi = material_time(own.time, own.displacement, -self.a)
        depth = own.displacement - own.displacement[0]
        pressure = hereditary_force(*self._drainage, xi, depth, own.sagitta)
        return below.force(motion) + pressure

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and no pressure."""
        return below.begin(displacement), Relaxing(displacement, np.zeros(1))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the pressure added."""
        inner, own = state
        inner, force = below.step(inner, line)
        xi_step = material_duration(line.duration, own.depth, line.displacement, -self.a)
        own, pressure = hereditary_step(*self._drainage, own, xi_step, line.displacement)
        return (inner, own), force + pressure

    @property
    def _drainage(self) -> tuple[Linear, Prony]:
        return fading(self.k, 1.0 / self.tau)
