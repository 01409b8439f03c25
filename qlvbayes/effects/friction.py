"""Define friction: dry friction reverses over a short distance."""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import fading
from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant


class Friction(AbstractEffect):
    """Dry friction: F = F_below + strength z, dz/dt = (v/reach)(1 - z sgn v), z(0) = 0.

    Over the distance travelled this is one relaxing mode.

    * ``strength``: force of steady sliding (N), zero or more.
    * ``reach``: distance over which it reverses (mm).
    """

    strength: Constant
    reach: Constant
    name: ClassVar[str] = "friction"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 4
    units: ClassVar[dict[str, str]] = {"strength": "force", "reach": "displacement"}
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    law: ClassVar[str] = "dz/dt = (v/reach)(1 - z sgn v), F += strength z"
    seen: ClassVar[str] = "a constant force against the motion, at any speed, that stays in holds"
    reference: ClassVar[str] = "Dahl 1968, A solid friction model, Aerospace Corporation"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a strength scaled by the peak force.

        The reach lies near 3 % of the depth.
        """
        return cls(scales.positive(1.0), lognormal(0.03 * scales.depth, 2.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the friction added."""
        return below.force(motion) + self.strength * slide(motion, self.reach)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and that of friction before any sliding."""
        return below.begin(displacement), unslid(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the friction added."""
        inner, own = state
        inner, force = below.step(inner, line)
        own, slid = slide_step(own, line, self.reach)
        return (inner, own), force + self.strength * slid


def slide(motion: Motion, reach: Array) -> Array:
    """Return Dahl's z (N,): dz = (1 - z sgn v) dd / reach, z = 0 at first."""
    displacement = motion.alone.displacement
    travelled = jnp.cumsum(jnp.abs(jnp.diff(displacement, prepend=displacement[:1])))
    return hereditary_force(*_sliding(reach), travelled, displacement - displacement[0])


def unslid(displacement: Array) -> Relaxing:
    """Return the state of friction at a motion's first point."""
    return Relaxing(displacement, jnp.zeros(1))


def slide_step(own: Relaxing, line: Line, reach: Array) -> tuple[Relaxing, Array]:
    """Return the state of friction and Dahl's z after a line."""
    travelled = jnp.abs(line.displacement - own.depth)
    return hereditary_step(*_sliding(reach), own, travelled, line.displacement)


def _sliding(reach: Array) -> tuple[Linear, Prony]:
    """Return the laws whose hereditary integral over the distance travelled is Dahl's z."""
    return fading(1.0 / reach, 1.0 / reach)
