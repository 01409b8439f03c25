"""Define thixotropy: motion breaks down structure, and rest builds it up again."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import fading
from qlvbayes.effects.spans import resolved_times
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Thixotropy(AbstractEffect):
    r"""Weakening by motion: F = F_below (1 - share y), dy/dt = (1 - y) speed/way - y/time.

    y = 0 at first. In :math:`\xi = t/time + s/way`, with s the distance travelled, y is one
    relaxing mode driven by s/way.

    * ``share``: share of the force that is lost where all structure is broken down, zero or more.
    * ``time``: time constant of its recovery at rest (s).
    * ``way``: distance over which motion breaks it down (mm).
    """

    share: Constant
    time: Constant
    way: Constant
    name: ClassVar[str] = "thixotropy"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 3
    units: ClassVar[dict[str, str]] = {"share": "fraction", "time": "time", "way": "displacement"}
    null: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "F -> F (1 - share y), dy/dt = |v| (1 - y)/way - y/time"
    seen: ClassVar[str] = "weaker after motion, and a force that rises again in holds"
    reference: ClassVar[str] = "Moore 1959; Barnes 1997, doi:10.1016/S0377-0257(97)00004-9"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a share scaled by the peak force."""
        low, high = resolved_times(scales)
        return cls(
            scales.positive(0.7 * scales.force),
            LogUniform(low, high),
            lognormal(0.5 * scales.depth, 3.0),
        )

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force, weakened by the broken-down structure."""
        travel = xp.abs(xp.steps(motion.displacement))
        moved = xp.cumsum(travel) / self.way
        xi_step = (motion.time - motion.time[0]) / self.time + moved
        return below.force(motion) * (
            1.0 - self.share * hereditary_force(*fading(1.0, 1.0), xi_step, moved)
        )

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, the depth, and intact structure."""
        nothing = Relaxing(xp.zeros_like(displacement), np.zeros(1))
        return below.begin(displacement), displacement, nothing

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force, weakened by the broken-down structure."""
        inner, depth, own = state
        inner, force = below.step(inner, line)
        moved = xp.abs(line.displacement - depth) / self.way
        xi_step = line.duration / self.time + moved
        own, broken = hereditary_step(*fading(1.0, 1.0), own, xi_step, own.depth + moved)
        return (inner, line.displacement, own), force * (1.0 - self.share * broken)
