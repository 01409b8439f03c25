"""Drag of a fluid and mass of what moves: forces that follow the platen's speed or acceleration."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_AGAIN = 3.0  # errors of a mass that impulses show, which its prior spans


class ViscousDrag(AbstractEffect):
    """Drag proportional to speed: F = F_below + eta v, v the velocity of the pad's surface.

    * ``eta``: drag coefficient (N s/mm), zero or more.
    """

    eta: Constant
    name: ClassVar[str] = "viscous_drag"
    level: ClassVar[Level] = Level.ADDING
    units: ClassVar[dict[str, str]] = {"eta": "drag"}
    null: ClassVar[dict[str, float]] = {"eta": 0.0}
    law: ClassVar[str] = "F += eta v"
    seen: ClassVar[str] = "steps of the force at each start and stop, proportional to speed"
    needs: ClassVar[str] = "velocity"
    reference: ClassVar[str] = "Kelvin & Voigt; Findley, Lai & Onaran 1976, ch. 5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with eta scaled by the top speed."""
        return cls(scales.positive(scales.speed if scales.speed > 0.0 else 1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with eta v added."""
        return below.force(motion) + self.eta * motion.velocity

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with eta v added."""
        state, force = below.step(state, line)
        return state, force + self.eta * line.velocity


_POWERS = (0.1, 0.8)
"""Bounds of n. Grease and polymer melts thin with 0.2 to 0.7; at 0.9 it is viscous_drag.

After the constants of a pad have taken their part, 14 % of its force at 0.8 is not viscous drag's,
and 7 % at 0.9. Towards 0 it stays apart from friction, which does not end in a hold.
"""


class PowerLawDrag(AbstractEffect):
    """Drag that grows more slowly than speed: F = F_below + k abs(v)^n sgn v, v in mm/s.

    * ``k``: drag at 1 mm/s (N (s/mm)^n), zero or more.
    * ``n``: exponent, above 0 and below 1, where 1 is viscous drag.
    """

    k: Constant
    n: Constant
    name: ClassVar[str] = "power_law_drag"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"k": "power_drag", "n": "fraction"}
    null: ClassVar[dict[str, float]] = {"k": 0.0}
    law: ClassVar[str] = "F += k |v|^n sgn v"
    seen: ClassVar[str] = "steps of the force at each start and stop that grow slowly with speed"
    needs: ClassVar[str] = "velocity"
    reference: ClassVar[str] = "Herschel & Bulkley 1926, doi:10.1007/BF01432034"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with k scaled by the top speed to the middle exponent."""
        speed = scales.speed if scales.speed > 0.0 else 1.0
        return cls(scales.positive(speed**0.55), Uniform(*_POWERS))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the drag added; at rest the drag and its slopes are 0."""
        return below.force(motion) + self._drag(motion.velocity)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the drag added."""
        state, force = below.step(state, line)
        return state, force + self._drag(line.velocity)

    def _drag(self, velocity: Array) -> Array:
        speed = xp.abs(velocity)
        moving = speed > 0.0
        size = xp.where(moving, speed, 1.0) ** self.n
        return self.k * xp.where(moving, xp.sign(velocity) * size, 0.0)


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


class GuideDrag(ViscousDrag):
    """Drag of the rig: F = F_below + eta v, v the platen's velocity, outside the contact.

    Oil in a bearing, or air or a bath around the platen, drags where the pad is off it too, and
    makes the force negative there on the way back. While the pad is pressed this is viscous_drag.

    * ``eta``: drag coefficient (N s/mm), zero or more.
    """

    eta: Constant
    name: ClassVar[str] = "guide_drag"
    level: ClassVar[Level] = Level.GUIDE
    rank: ClassVar[int] = 1
    off_pad: ClassVar[bool] = True
    generalises: ClassVar[str] = ViscousDrag.name
    law: ClassVar[str] = "F += eta v, also off the pad"
    seen: ClassVar[str] = "steps of the force at each start and stop, also where nothing is touched"
    reference: ClassVar[str] = "Stokes 1851; Stribeck 1902, Z. VDI 46"


class GuidePowerLawDrag(PowerLawDrag):
    """Drag of the rig that grows more slowly than speed: F = F_below + k abs(v)^n sgn v.

    v is the platen's velocity in mm/s. Grease in a bearing shears so, where the pad is off the
    platen too. While the pad is pressed this is power_law_drag.

    * ``k``: drag at 1 mm/s (N (s/mm)^n), zero or more.
    * ``n``: exponent, above 0 and below 1, where 1 is guide_drag.
    """

    k: Constant
    n: Constant
    name: ClassVar[str] = "guide_power_law_drag"
    level: ClassVar[Level] = Level.GUIDE
    rank: ClassVar[int] = 2
    off_pad: ClassVar[bool] = True
    generalises: ClassVar[str] = PowerLawDrag.name
    law: ClassVar[str] = "F += k |v|^n sgn v, also off the pad"
    seen: ClassVar[str] = "steps of the force that grow slowly with speed, also off the pad"
    reference: ClassVar[str] = "Herschel & Bulkley 1926, doi:10.1007/BF01432034"


class Inertia(AbstractEffect):
    """Force that accelerates a mass: F = F_below + mass a, a the platen's acceleration.

    * ``mass``: mass that moves with the load cell (N s2/mm, which is 1000 kg), zero or more.
    """

    mass: Constant
    name: ClassVar[str] = "inertia"
    level: ClassVar[Level] = Level.SENSOR
    units: ClassVar[dict[str, str]] = {"mass": "mass"}
    null: ClassVar[dict[str, float]] = {"mass": 0.0}
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += mass a"
    seen: ClassVar[str] = "pulses of the force while the platen speeds up or brakes"
    needs: ClassVar[str] = "acceleration"
    not_stepped: ClassVar[str] = (
        "straight lines have no acceleration but at their ends, where it has no bound"
    )
    reference: ClassVar[str] = "Newton 1687, second law"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with the mass that impulses show, or scaled by the acceleration.

        The prior spans three errors of that mass, as the fit reads the same readings once more.
        """
        if scales.mass is not None:
            mass, sd = scales.mass
            return cls(lognormal(mass, 1.0 + _AGAIN * sd / mass))
        return cls(scales.positive(scales.acceleration if scales.acceleration > 0.0 else 1.0))

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        """Return why the records do not give it: neither accelerations nor impulses."""
        return None if protocol.mass_shown else super().unmeasured(protocol)

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with mass times acceleration added."""
        return below.force(motion) + self.mass * motion.acceleration
