"""Define adhesion: the surface carries tension on retraction, then lets go."""

from __future__ import annotations

import math
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.laws.layered import Law, State, line_at_depth, touching
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_GONE = 40.0  # in strengths; beyond, less than e^-294 of the tension is left


class Adhesion(AbstractEffect):
    """Tension of the surface: F = F_below e^{-(F_below/strength)^2/(2e)} where F_below < 0.

    Where F_below is positive, F = F_below. The surface carries tension up to ``strength`` and lets
    go beyond. This is a cohesive law, the same on release and on renewed contact. At strength 0 the
    force is never negative, which is the contact of a loose specimen that this effect replaces.

    * ``strength``: the largest tension (N), zero or more.
    """

    strength: Constant
    name: ClassVar[str] = "adhesion"
    level: ClassVar[Level] = Level.CONTACT
    units: ClassVar[dict[str, str]] = {"strength": "force"}
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    inverts: ClassVar[bool] = False
    not_inverted: ClassVar[str] = (
        "while the surface lets go, one tension is that of two displacements"
    )
    law: ClassVar[str] = "tension up to strength on retraction, then release"
    seen: ClassVar[str] = "negative force when the platen retracts, then none"
    reference: ClassVar[str] = "Xu & Needleman 1993, doi:10.1088/0965-0393/1/2/003"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a strength scaled by the peak force."""
        return cls(scales.positive(1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with tension limited by the strength."""
        return self._with_limited_tension(below.force(touching(motion)))

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath at the specimen's depth."""
        return below.begin(xp.maximum(displacement, 0.0))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with tension limited by the strength."""
        state, raw = below.step(state, line_at_depth(line, line.displacement))
        return state, self._with_limited_tension(raw)

    def _with_limited_tension(self, raw: Array) -> Array:
        gone = raw <= -_GONE * self.strength  # there the ratio or its square may not be finite
        ratio = xp.where(gone, 0.0, raw) / xp.where(self.strength > 0.0, self.strength, 1.0)
        tension = xp.where(gone, 0.0, raw * xp.exp(-(ratio**2) / (2.0 * math.e)))
        return xp.where(raw > 0.0, raw, tension)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: it needs a loose specimen and full retraction."""
        if protocol.bonded:
            return "the specimen is fixed to the platen"
        return None if protocol.returns else "no test retracts to zero depth"
