"""Drag, friction and mass: forces that follow the platen's speed, way or acceleration."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, AbstractPointwise, Level, Protocol
from qlvbayes.effects.history import dragged, fading, travelled
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array

_AGAIN = 3.0  # errors of a mass that impulses show, which its prior spans


class ViscousDrag(AbstractPointwise):
    """Drag proportional to speed: F = F_below + eta v, v the velocity of the pad's surface."""

    eta: Constant = constant("drag", "drag coefficient, zero or more")
    name = "viscous_drag"
    level = Level.ADDING
    law = "F += eta v"
    seen = "steps of the force at each start and stop, proportional to speed"
    needs = "velocity"
    reference = "Kelvin & Voigt; Findley, Lai & Onaran 1976, ch. 5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(scales.top_speed))

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        return force + self.eta * now.velocity


class GuideDrag(ViscousDrag):
    """Drag of the rig: F = F_below + eta v, v the platen's velocity, outside the contact.

    Oil in a bearing, or air or a bath around the platen, drags where the pad is off it too, and
    makes the force negative there on the way back. While the pad is pressed this is viscous_drag.
    """

    name = "guide_drag"
    level = Level.GUIDE
    rank = 1
    off_pad = True
    generalises = ViscousDrag.name
    law = "F += eta v, also off the pad"
    seen = "steps of the force at each start and stop, also where nothing is touched"
    reference = "Stokes 1851; Stribeck 1902, Z. VDI 46"


_POWERS = (0.1, 0.8)

"""Bounds of n. Grease and polymer melts thin with 0.2 to 0.7; at 0.9 it is viscous_drag.

After the constants of a pad have taken their part, 14 % of its force at 0.8 is not viscous drag's,
and 7 % at 0.9. Towards 0 it stays apart from friction, which does not end in a hold.
"""


class PowerLawDrag(AbstractPointwise):
    """Drag that grows more slowly than speed: F = F_below + k abs(v)^n sgn v, v in mm/s."""

    k: Constant = constant("power_drag", "drag at 1 mm/s, zero or more")
    n: Constant = constant("fraction", "exponent, above 0 and below 1, where 1 is viscous drag")
    name = "power_law_drag"
    level = Level.ADDING
    rank = 1
    law = "F += k |v|^n sgn v"
    seen = "steps of the force at each start and stop that grow slowly with speed"
    needs = "velocity"
    reference = "Herschel & Bulkley 1926, doi:10.1007/BF01432034"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # scaled by the top speed to the middle exponent
        return cls(scales.positive(scales.top_speed**0.55), Uniform(*_POWERS))

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        speed = xp.abs(now.velocity)
        moving = speed > 0.0  # at rest the drag and its slopes are 0
        size = xp.where(moving, speed, 1.0) ** self.n
        return force + self.k * xp.where(moving, xp.sign(now.velocity) * size, 0.0)


class GuidePowerLawDrag(PowerLawDrag):
    """Drag of the rig that grows more slowly than speed: F = F_below + k abs(v)^n sgn v.

    v is the platen's velocity in mm/s. Grease in a bearing shears so, where the pad is off the
    platen too. While the pad is pressed this is power_law_drag.
    """

    name = "guide_power_law_drag"
    level = Level.GUIDE
    rank = 2
    off_pad = True
    generalises = PowerLawDrag.name
    law = "F += k |v|^n sgn v, also off the pad"
    seen = "steps of the force that grow slowly with speed, also off the pad"


_THINNEST = 0.05  # share of its thickness that the film keeps

_GAPS = (1.05, 4.0)

"""Bounds of the film's thickness over the largest depth: not touched, and squeezed to 3/4 of it.

A thicker film drags alike all along the travel, which is viscous_drag: 34 % of its force is not
that drag's at 4 depths, 22 % at 6 and 12 % at 10.
"""


class SqueezeFilm(AbstractPointwise):
    """Drag of a film that is squeezed out: F = F_below + eta v / max(1 - d/h, 0.05)^3."""

    eta: Constant = constant("drag", "drag coefficient at zero depth, zero or more")
    h: Constant = constant("displacement", "the film's thickness")
    name = "squeeze_film"
    level = Level.ADDING
    rank = 2
    law = "F += eta v / (1 - delta/h)^3"
    seen = "drag that grows with depth"
    needs = "velocity"
    reference = "Reynolds 1886, doi:10.1098/rstl.1886.0005"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        thickness = LogUniform(*(share * scales.depth for share in _GAPS))
        return cls(scales.positive(3.0 * scales.top_speed), thickness)

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        left = xp.maximum(1.0 - now.displacement / self.h, _THINNEST)
        return force + self.eta * now.velocity / (left * left * left)


class Inertia(AbstractEffect):
    """Force that accelerates a mass: F = F_below + mass a, a the platen's acceleration."""

    mass: Constant = constant(
        "mass", "mass that moves with the load cell (N s2/mm, which is 1000 kg), zero or more"
    )
    name = "inertia"
    level = Level.SENSOR
    off_pad = True
    law = "F += mass a"
    seen = "pulses of the force while the platen speeds up or brakes"
    needs = "acceleration"
    not_stepped = "straight lines have no acceleration but at their ends, where it has no bound"
    reference = "Newton 1687, second law"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        if scales.mass is not None:  # shown by impulses, whose readings the fit uses once more
            mass, sd = scales.mass
            return cls(lognormal(mass, 1.0 + _AGAIN * sd / mass))
        return cls(scales.positive(scales.acceleration if scales.acceleration > 0.0 else 1.0))

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        return None if protocol.mass_shown else super().unmeasured(protocol)

    def force(self, below: Law, motion: Motion) -> Array:
        return below.force(motion) + self.mass * motion.acceleration


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
    name = "friction"
    level = Level.ADDING
    rank = 4
    law = "dz/dt = (v/reach)(1 - z sgn v), F += strength z"
    seen = "a constant force against the motion, at any speed, that stays in holds"
    reference = "Dahl 1968, A solid friction model, Aerospace Corporation"

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
    name = "sharp_friction"
    generalises = Friction.name
    reduces: ClassVar[dict[str, float]] = {"sharp": 0.0}
    law = "F += strength ((1 - sharp) z + sharp s), ds = d delta/reach, |s| <= 1"
    seen = "a force against the motion, at any speed, that turns round with a corner"
    reference = "Prandtl 1928, doi:10.1002/zamm.19280080202; Iwan 1966"

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

    name = "guide_friction"
    level = Level.GUIDE
    rank = 0
    off_pad = True
    law = "F += strength ((1 - sharp) z + sharp s), also off the pad"
    seen = "a force against the motion, at any speed, also where nothing is touched"
    reference = "Armstrong-Helouvry et al. 1994, doi:10.1016/0005-1098(94)90209-7"


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
    name = "pressure_friction"
    generalises = Friction.name
    reduces: ClassVar[dict[str, float]] = {"share": 0.0}
    law = "F += strength (1 - share + share F/pressed) z"
    seen = "a force against the motion, at any speed, larger the harder it presses"
    reference = "Amontons 1699; Derjaguin 1934, Z. Phys. 88"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        plain = Friction.default(scales)
        return cls(plain.strength, plain.reach, Uniform(0.0, 1.0), scales.force)

    def rubbed(self, force: Array, slid: Array) -> Array:
        grown = 1.0 + self.share * (xp.maximum(force, 0.0) / self.pressed - 1.0)
        return force + self.strength * grown * slid
