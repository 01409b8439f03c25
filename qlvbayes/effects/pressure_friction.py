"""Define pressure friction: dry friction grows with the pad's force."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.friction import AbstractFriction, Friction, reversing
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class PressureFriction(AbstractFriction):
    """Friction that grows with the force: F = F_below + strength w z, z as in friction.

    w = 1 - share + share max(F_below, 0)/pressed. At share 1 this is Coulomb's friction with the
    coefficient strength/pressed.

    * ``strength``: force of steady sliding (N) where the pad's force is ``pressed``, zero or more.
    * ``reach``: distance over which it reverses (mm).
    * ``share``: share of the friction that is proportional to the force, from 0 to 1.
    * ``pressed``: reference force (N), which is fixed.
    """

    strength: Constant
    reach: Constant
    share: Constant
    pressed: Constant
    name: ClassVar[str] = "pressure_friction"
    units: ClassVar[dict[str, str]] = {
        "strength": "force",
        "reach": "displacement",
        "share": "fraction",
        "pressed": "force",
    }
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    generalises: ClassVar[str] = Friction.name
    reduces: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "F += strength (1 - share + share F/pressed) z"
    seen: ClassVar[str] = "a force against the motion, at any speed, larger the harder it presses"
    reference: ClassVar[str] = "Amontons 1699; Derjaguin 1934, Z. Phys. 88"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a strength scaled by the peak force, which is its reference."""
        return cls(
            scales.positive(1.0),
            reversing(scales),
            Uniform(0.0, 1.0),
            scales.force,
        )

    def rubbed(self, force: Array, slid: Array) -> Array:
        """Return F_below + strength w z."""
        grown = 1.0 + self.share * (xp.maximum(force, 0.0) / self.pressed - 1.0)
        return force + self.strength * grown * slid
