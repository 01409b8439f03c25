"""Dry friction: a force against the motion at any speed, in the rig or at the specimen."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import dragged, fading, travelled
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import Relaxing, at_first, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array

_REACHES = (0.002, 0.2)
"""Bounds of the reach over the depth: what an encoder shows, and an end of sliding in the travel.

Friction that never comes to slide is a spring beside the pad's, with a loop that permanent_set has
as well: a cosine of 0.90 at 0.1 of the depth, of 0.77 at 0.01.
"""


class Friction(AbstractEffect):
    """Dry friction: F = F_below + strength z, dz/dt = (v/reach)(1 - z sgn v), z(0) = 0.

    Over the distance travelled z is one relaxing mode.
    """

    strength: Constant = constant("force", "force of steady sliding, zero or more")
    reach: Constant = constant("displacement", "distance over which it reverses")
    name: ClassVar[str] = "friction"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 4
    law: ClassVar[str] = "dz/dt = (v/reach)(1 - z sgn v), F += strength z"
    seen: ClassVar[str] = "a constant force against the motion, at any speed, that stays in holds"
    reference: ClassVar[str] = "Dahl 1968, A solid friction model, Aerospace Corporation"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        reach = LogUniform(*(share * scales.depth for share in _REACHES))
        return cls(scales.positive(1.0), reach)

    def rubbed(self, force: Array, slid: Array) -> Array:
        """Return a force (N) with the friction added where Dahl's z is ``slid``."""
        return force + self.strength * slid

    def force(self, below: Law, motion: Motion) -> Array:
        return self.rubbed(below.force(motion), self.slid(motion.alone.displacement))

    def slid(self, displacement: Array) -> Array:
        """Return z at the points of a motion (N,)."""
        way = travelled(displacement)
        return hereditary_force(*self._sliding, way, displacement - displacement[0])

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), Relaxing(displacement, np.zeros(1))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, own = state
        inner, force = below.step(inner, line)
        way = xp.abs(line.displacement - own.depth)
        own, slid = hereditary_step(*self._sliding, own, way, line.displacement)
        return (inner, own), self.rubbed(force, slid)

    @property
    def _sliding(self) -> tuple[Linear, Prony]:
        """The laws whose hereditary integral over the distance travelled is Dahl's z."""
        return fading(1.0 / self.reach, 1.0 / self.reach)


class SharpFriction(Friction):
    """Friction that yields sharply in part: F = F_below + strength ((1 - sharp) z + sharp s).

    z is Dahl's, as in friction. s is a spring in series with a slider (Prandtl, Jenkins): ds =
    dd/reach, but s never leaves -1 to 1, and s(0) = 0. With p the place of the slider, s = (d -
    p)/reach and p = min(max(p_before, d - reach), d + reach), which is exact along straight lines.
    Many sliders side by side, a share of which yields at one distance and the rest at distances
    spread exponentially, make this law (Iwan).
    """

    sharp: Constant = constant(
        "fraction", "share that yields at once, from 0 (Dahl) to 1 (elastic, then sliding)"
    )
    name: ClassVar[str] = "sharp_friction"
    generalises: ClassVar[str] = Friction.name
    reduces: ClassVar[dict[str, float]] = {"sharp": 0.0}
    law: ClassVar[str] = "F += strength ((1 - sharp) z + sharp s), ds = d delta/reach, |s| <= 1"
    seen: ClassVar[str] = "a force against the motion, at any speed, that turns round with a corner"
    reference: ClassVar[str] = "Prandtl 1928, doi:10.1002/zamm.19280080202; Iwan 1966"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        plain = Friction.default(scales)
        return cls(plain.strength, plain.reach, Uniform(0.0, 1.0))

    def slid(self, displacement: Array) -> Array:
        """Return (1 - sharp) z + sharp s at the points of a motion."""
        slider = dragged(displacement, self.reach, self.reach)
        return self._shared(super().slid(displacement), displacement, slider)

    def begin(self, below: Law, displacement: Array) -> State:
        return super().begin(below, displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        (inner, own), slider = state
        inner, force = below.step(inner, line)
        way = xp.abs(line.displacement - own.depth)
        own, slid = hereditary_step(*self._sliding, own, way, line.displacement)
        slider = xp.clip(slider, line.displacement - self.reach, line.displacement + self.reach)
        slid = self._shared(slid, line.displacement, slider)
        return ((inner, own), slider), self.rubbed(force, slid)

    def _shared(self, dahl: Array, displacement: Array, slider: Array) -> Array:
        sprung = (displacement - slider) / self.reach
        return dahl + self.sharp * (sprung - dahl)


class GuideFriction(SharpFriction):
    """Friction of the rig: F = F_below + strength ((1 - sharp) z + sharp s), outside the contact.

    z and s are those of sharp_friction, along the platen's displacement. A guide or a bearing
    between platen and load cell rubs where the pad is off the platen too, and makes the force
    negative there on the way back. While the pad is pressed this is sharp_friction.

    * ``strength``: force of steady sliding (N), zero or more.
    * ``reach``: distance over which the spring yields, and over which Dahl's z follows (mm).
    * ``sharp``: share that yields at once, from 0 (Dahl) to 1 (elastic, then sliding).
    """

    name: ClassVar[str] = "guide_friction"
    level: ClassVar[Level] = Level.GUIDE
    rank: ClassVar[int] = 0
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += strength ((1 - sharp) z + sharp s), also off the pad"
    seen: ClassVar[str] = "a force against the motion, at any speed, also where nothing is touched"
    reference: ClassVar[str] = "Armstrong-Helouvry et al. 1994, doi:10.1016/0005-1098(94)90209-7"


class PressureFriction(Friction):
    """Friction that grows with the force: F = F_below + strength w z, z as in friction.

    w = 1 - share + share max(F_below, 0)/pressed. At share 1 this is Coulomb's friction with the
    coefficient strength/pressed.
    """

    strength: Constant = constant(
        "force", "force of steady sliding where the pad's force is ``pressed``, zero or more"
    )
    share: Constant = constant(
        "fraction", "share of the friction that is proportional to the force, from 0 to 1"
    )
    pressed: Constant = constant("force", "reference force, which is fixed")
    name: ClassVar[str] = "pressure_friction"
    generalises: ClassVar[str] = Friction.name
    reduces: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "F += strength (1 - share + share F/pressed) z"
    seen: ClassVar[str] = "a force against the motion, at any speed, larger the harder it presses"
    reference: ClassVar[str] = "Amontons 1699; Derjaguin 1934, Z. Phys. 88"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        plain = Friction.default(scales)
        return cls(plain.strength, plain.reach, Uniform(0.0, 1.0), scales.force)

    def rubbed(self, force: Array, slid: Array) -> Array:
        grown = 1.0 + self.share * (xp.maximum(force, 0.0) / self.pressed - 1.0)
        return force + self.strength * grown * slid


class InterfaceSlip(AbstractEffect):
    """Sliding of the specimen in its grips: its depth e follows de = (1 - yielding e sgn v) dd.

    It slides a little from the start, and as much as the platen moves where e has come to
    1/yielding, whose elastic force is the most that the interface transmits. At a turn it sticks
    again, and it is back at rest before the platen is. Over the distance travelled e is one
    relaxing mode. A loose specimen, which is pressed across its faces, does not slide.
    """

    yielding: Constant = constant(
        "exponent", "share of the motion that is lost for each unit of depth, zero or more"
    )
    name: ClassVar[str] = "interface_slip"
    level: ClassVar[Level] = Level.DEPTH
    rank: ClassVar[int] = -1  # the drive's play and the gap lie outside of the specimen's faces
    law: ClassVar[str] = "delta -> e, de = (1 - yielding e sgn v) d delta"
    seen: ClassVar[str] = (
        "softer the farther it goes, stiff at each turn, and back at rest too early"
    )
    reference: ClassVar[str] = "Mindlin & Deresiewicz 1953, doi:10.1115/1.4010702; Dahl 1968"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # with one return it is permanent_set to 0.99, whatever the prior: both lose depth on the
        # way; a second loading tells, as the set is there already and the slip begins anew
        return cls(scales.positive(0.5 * scales.depth**2 * scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        way = travelled(motion.displacement)
        depth = hereditary_force(*self._sliding, way, motion.displacement)
        share = self._followed(depth, motion.velocity)
        return below.force(motion.followed(depth, lambda rate: share * rate))

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), at_first(*self._sliding, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, slide = state
        way = xp.abs(line.displacement - slide.depth)
        slide, depth = hereditary_step(*self._sliding, slide, way, line.displacement)
        speed = self._followed(depth, line.velocity) * line.velocity
        inner, force = below.step(inner, replace(line, displacement=depth, velocity=speed))
        return (inner, slide), force

    @property
    def _sliding(self) -> tuple[Linear, Prony]:
        """The laws whose hereditary integral over the distance travelled is the depth."""
        return fading(1.0, self.yielding)

    def _followed(self, depth: Array, velocity: Array) -> Array:
        """Return the share of the platen's motion that the specimen follows."""
        return 1.0 - self.yielding * depth * xp.sign(velocity)

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        return None if protocol.bonded else "the specimen is pressed, not held by its faces"

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return cls.unmeasured(protocol) or (None if protocol.unloads else "no test unloads")
