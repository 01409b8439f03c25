"""Define stiffening frame: the rig deflects with force, the less the larger the force is."""

from __future__ import annotations

import math
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.frame_compliance import AbstractFrame, FrameCompliance
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class StiffeningFrame(AbstractFrame):
    """Deflection of a stiffening frame: depth = displacement - compliance F/(1 + abs(F)/stiff).

    F is the force itself; it is solved as for a frame that does not stiffen.

    * ``compliance``: compliance of the unloaded frame (mm/N), zero or more.
    * ``stiff``: force (N) at which the deflection is half that of a frame that does not stiffen.
    """

    compliance: Constant
    stiff: Constant
    name: ClassVar[str] = "stiffening_frame"
    units: ClassVar[dict[str, str]] = {"compliance": "compliance", "stiff": "force"}
    null: ClassVar[dict[str, float]] = {"compliance": 0.0}
    generalises: ClassVar[str] = FrameCompliance.name
    reduces: ClassVar[dict[str, float]] = {"stiff": math.inf}
    law: ClassVar[str] = "delta -> delta - compliance F/(1 + |F|/stiff)"
    seen: ClassVar[str] = "softer where the force is small, less so where it is large"
    reference: ClassVar[str] = "Kalidindi, Abusafieh & El-Danaf 1997, Exp. Mech. 37"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect scaled like a frame half as soft at the peak force."""
        return cls(scales.positive(scales.force**2 / scales.depth), lognormal(scales.force, 3.0))

    def deflection(self, force: Array) -> tuple[Array, Array]:
        """Return compliance F/(1 + abs(F)/stiff), and its slope."""
        softness = 1.0 / (1.0 + xp.abs(force) / self.stiff)
        return self.compliance * softness * force, self.compliance * softness**2
