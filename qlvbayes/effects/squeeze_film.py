"""Define squeeze film: the drag of a liquid film grows as it gets thin."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_THINNEST = 0.05  # share of its thickness that the film keeps
_GAPS = (1.05, 4.0)
"""Bounds of the film's thickness over the largest depth: not touched, and squeezed to 3/4 of it.

A thicker film drags alike all along the travel, which is viscous_drag: 34 % of its force is not
that drag's at 4 depths, 22 % at 6 and 12 % at 10.
"""


class SqueezeFilm(AbstractEffect):
    """Drag of a film that is squeezed out: F = F_below + eta v / max(1 - d/h, 0.05)^3.

    * ``eta``: drag coefficient at zero depth (N s/mm), zero or more.
    * ``h``: the film's thickness (mm).
    """

    eta: Constant
    h: Constant
    name: ClassVar[str] = "squeeze_film"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {"eta": "drag", "h": "displacement"}
    null: ClassVar[dict[str, float]] = {"eta": 0.0}
    law: ClassVar[str] = "F += eta v / (1 - delta/h)^3"
    seen: ClassVar[str] = "drag that grows with depth"
    needs: ClassVar[str] = "velocity"
    reference: ClassVar[str] = "Reynolds 1886, doi:10.1098/rstl.1886.0005"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with eta scaled by three times the top speed."""
        speed = scales.speed if scales.speed > 0.0 else 1.0
        depth = scales.depth
        return cls(scales.positive(3.0 * speed), LogUniform(*(share * depth for share in _GAPS)))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the film's drag added."""
        return below.force(motion) + self._film(motion)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the film's drag added."""
        state, force = below.step(state, line)
        return state, force + self._film(line)

    def _film(self, moved: Motion | Line) -> Array:
        left = xp.maximum(1.0 - moved.displacement / self.h, _THINNEST)
        return self.eta * moved.velocity / (left * left * left)
