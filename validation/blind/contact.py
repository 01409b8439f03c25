"""The contact of a rig whose platen starts a little above the pad."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from qlvbayes.simulate.hidden.effect import Effect
from qlvbayes.simulate.hidden.mesh import Array


@dataclass(frozen=True)
class NearContact(Effect):
    """d -> w [ln(1 + e^{(d - gap)/w}) - ln(1 + e^{-gap/w})]: contact within about w around a gap.

    w = width; both in mm. The platen starts `gap` above the pad.
    """

    name: ClassVar[str] = "near_contact"
    order: ClassVar[int] = 44
    positive: ClassVar[tuple[str, ...]] = ("width",)
    signed: ClassVar[tuple[str, ...]] = ("gap",)

    gap: float
    width: float

    def lost(self) -> float:
        """Depth that the contact takes away, mm."""
        return self.gap

    def on_depth(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        """Round the corner where contact begins."""
        arg = (depth - self.gap) / self.width
        start = np.logaddexp(0.0, -self.gap / self.width)
        share = 1.0 / (1.0 + np.exp(-np.clip(arg, -700.0, 700.0)))
        return self.width * (np.logaddexp(0.0, arg) - start), velocity * share

    def kinks(self, largest: Array) -> Array:
        """Around the gap."""
        return self.gap + self.width * np.array([-3.0, 0.0, 3.0])
