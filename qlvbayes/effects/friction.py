"""Define friction: dry friction reverses over a short distance."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import fading
from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_REACHES = (0.002, 0.2)
"""Bounds of the reach over the depth: what an encoder shows, and an end of sliding in the travel.

Friction that never comes to slide is a spring beside the pad's, with a loop that permanent_set has
as well: a cosine of 0.90 at 0.1 of the depth, of 0.77 at 0.01.
"""


class AbstractFriction(AbstractEffect):
    """Dry friction of Dahl: dz/dt = (v/reach)(1 - z sgn v), z(0) = 0.

    Over the distance travelled z is one relaxing mode.
    """

    strength: Constant  # first, as the order here is that of the fields
    reach: Constant
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 4

    @abstractmethod
    def rubbed(self, force: Array, slid: Array) -> Array:
        """Return a force (N) with the friction added where Dahl's z is ``slid``."""

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the friction added."""
        return self.rubbed(below.force(motion), self.slid(motion.alone.displacement))

    def slid(self, displacement: Array) -> Array:
        """Return z at the points of a motion (N,)."""
        travelled = xp.cumsum(xp.abs(xp.steps(displacement)))
        return hereditary_force(*self._sliding, travelled, displacement - displacement[0])

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and that of friction before any sliding."""
        return below.begin(displacement), Relaxing(displacement, np.zeros(1))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the friction added."""
        inner, own = state
        inner, force = below.step(inner, line)
        travelled = xp.abs(line.displacement - own.depth)
        own, slid = hereditary_step(*self._sliding, own, travelled, line.displacement)
        return (inner, own), self.rubbed(force, slid)

    @property
    def _sliding(self) -> tuple[Linear, Prony]:
        """The laws whose hereditary integral over the distance travelled is Dahl's z."""
        return fading(1.0 / self.reach, 1.0 / self.reach)


class Friction(AbstractFriction):
    """Dry friction: F = F_below + strength z, dz/dt = (v/reach)(1 - z sgn v), z(0) = 0.

    * ``strength``: force of steady sliding (N), zero or more.
    * ``reach``: distance over which it reverses (mm).
    """

    strength: Constant
    reach: Constant
    name: ClassVar[str] = "friction"
    units: ClassVar[dict[str, str]] = {"strength": "force", "reach": "displacement"}
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    law: ClassVar[str] = "dz/dt = (v/reach)(1 - z sgn v), F += strength z"
    seen: ClassVar[str] = "a constant force against the motion, at any speed, that stays in holds"
    reference: ClassVar[str] = "Dahl 1968, A solid friction model, Aerospace Corporation"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a strength scaled by the peak force."""
        return cls(scales.positive(1.0), reversing(scales))

    def rubbed(self, force: Array, slid: Array) -> Array:
        """Return F_below + strength z."""
        return force + self.strength * slid


def reversing(scales: Scales) -> LogUniform:
    """Return the prior of the distance (mm) over which friction reverses."""
    return LogUniform(*(share * scales.depth for share in _REACHES))
