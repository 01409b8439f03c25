"""Define slip: what the specimen's interface can transmit is limited, and it slides under load."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import fading
from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.hereditary import at_first, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class InterfaceSlip(AbstractEffect):
    """Sliding of the specimen in its grips: its depth e follows de = (1 - yielding e sgn v) dd.

    It slides a little from the start, and as much as the platen moves where e has come to
    1/yielding, whose elastic force is the most that the interface transmits. At a turn it sticks
    again, and it is back at rest before the platen is. Over the distance travelled e is one
    relaxing mode. A loose specimen, which is pressed across its faces, does not slide.

    * ``yielding``: share of the motion that is lost for each unit of depth (1/mm), zero or more.
    """

    yielding: Constant
    name: ClassVar[str] = "interface_slip"
    level: ClassVar[Level] = Level.DEPTH
    rank: ClassVar[int] = -1  # the drive's play and the gap lie outside of the specimen's faces
    units: ClassVar[dict[str, str]] = {"yielding": "exponent"}
    null: ClassVar[dict[str, float]] = {"yielding": 0.0}
    law: ClassVar[str] = "delta -> e, de = (1 - yielding e sgn v) d delta"
    seen: ClassVar[str] = (
        "softer the farther it goes, stiff at each turn, and back at rest too early"
    )
    reference: ClassVar[str] = "Mindlin & Deresiewicz 1953, doi:10.1115/1.4010702; Dahl 1968"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a yielding scaled by half of the squared depth."""
        # with one return it is permanent_set to 0.99, whatever the prior: both lose depth on the
        # way; a second loading tells, as the set is there already and the slip begins anew
        return cls(scales.positive(0.5 * scales.depth**2 * scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath at the specimen's own depth."""
        displacement = motion.displacement
        travelled = xp.cumsum(xp.abs(xp.steps(displacement)))
        depth = hereditary_force(*self._sliding(), travelled, displacement)
        share = self._followed(depth, motion.velocity)
        followed = replace(
            motion,
            displacement=depth,
            velocity=share * motion.velocity,
            acceleration=share * motion.acceleration,
            sagitta=None if motion.sagitta is None else share * motion.sagitta,
        )
        return below.force(followed)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the slide's before any travel."""
        slide = at_first(*self._sliding(), displacement)
        return below.begin(displacement), slide

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force after a line along which the specimen slides."""
        inner, slide = state
        travelled = xp.abs(line.displacement - slide.depth)
        slide, depth = hereditary_step(*self._sliding(), slide, travelled, line.displacement)
        speed = self._followed(depth, line.velocity) * line.velocity
        inner, force = below.step(inner, replace(line, displacement=depth, velocity=speed))
        return (inner, slide), force

    def _sliding(self) -> tuple[Linear, Prony]:
        """Return the laws whose hereditary integral over the distance travelled is the depth."""
        return fading(1.0, self.yielding)

    def _followed(self, depth: Array, velocity: Array) -> Array:
        """Return the share of the platen's motion that the specimen follows."""
        return 1.0 - self.yielding * depth * xp.sign(velocity)

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        """Return why it is not looked for: a specimen that is pressed does not slide."""
        return None if protocol.bonded else "the specimen is pressed, not held by its faces"

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: until a turn it is another elastic law."""
        return cls.unmeasured(protocol) or (None if protocol.unloads else "no test unloads")
