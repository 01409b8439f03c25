"""Define sharp friction: a part of what rubs sticks like a spring, then slides at once."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.friction import AbstractFriction, Friction, reversing
from qlvbayes.effects.history import confined
from qlvbayes.laws.hereditary import hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class SharpFriction(AbstractFriction):
    """Friction that yields sharply in part: F = F_below + strength ((1 - sharp) z + sharp s).

    z is Dahl's, as in friction. s is a spring in series with a slider (Prandtl, Jenkins): ds =
    dd/reach, but s never leaves -1 to 1, and s(0) = 0. With p the place of the slider, s = (d -
    p)/reach and p = min(max(p_before, d - reach), d + reach), which is exact along straight lines.
    Many sliders side by side, a share of which yields at one distance and the rest at distances
    spread exponentially, make this law (Iwan).

    * ``strength``: force of steady sliding (N), zero or more.
    * ``reach``: distance over which the spring yields, and over which Dahl's z follows (mm).
    * ``sharp``: share that yields at once, from 0 (Dahl) to 1 (elastic, then sliding).
    """

    strength: Constant
    reach: Constant
    sharp: Constant
    name: ClassVar[str] = "sharp_friction"
    units: ClassVar[dict[str, str]] = {
        "strength": "force",
        "reach": "displacement",
        "sharp": "fraction",
    }
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    generalises: ClassVar[str] = Friction.name
    reduces: ClassVar[dict[str, float]] = {"sharp": 0.0}
    law: ClassVar[str] = "F += strength ((1 - sharp) z + sharp s), ds = d delta/reach, |s| <= 1"
    seen: ClassVar[str] = "a force against the motion, at any speed, that turns round with a corner"
    reference: ClassVar[str] = "Prandtl 1928, doi:10.1002/zamm.19280080202; Iwan 1966"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with the strength and the reach of friction; the share is uniform."""
        return cls(scales.positive(1.0), reversing(scales), Uniform(0.0, 1.0))

    def slid(self, displacement: Array) -> Array:
        """Return (1 - sharp) z + sharp s at the points of a motion."""
        first = displacement[:1]
        low = xp.concatenate([first, displacement[1:] - self.reach])
        high = xp.concatenate([first, displacement[1:] + self.reach])
        slider, _ = xp.accumulate(confined, (low, high))
        return self._shared(super().slid(displacement), displacement, slider)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of friction, and the place of the slider."""
        return super().begin(below, displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the friction added."""
        (inner, own), slider = state
        inner, force = below.step(inner, line)
        travelled = xp.abs(line.displacement - own.depth)
        own, slid = hereditary_step(*self._sliding, own, travelled, line.displacement)
        slider = xp.clip(slider, line.displacement - self.reach, line.displacement + self.reach)
        slid = self._shared(slid, line.displacement, slider)
        return ((inner, own), slider), self.rubbed(force, slid)

    def rubbed(self, force: Array, slid: Array) -> Array:
        """Return F_below + strength times what has slid."""
        return force + self.strength * slid

    def _shared(self, dahl: Array, displacement: Array, slider: Array) -> Array:
        sprung = (displacement - slider) / self.reach
        return dahl + self.sharp * (sprung - dahl)
