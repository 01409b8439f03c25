"""A second spring: a void that closes, or a backing that is reached."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Uniform

_RANGE = (
    0.1,
    0.95,
)  # of the largest depth: nearer to its ends it is another elastic law, or unseen


class SecondContact(AbstractEffect):
    """F = F_below + stiffness max(d - depth, 0).

    stiffness: of the second spring (N/mm), zero or more; depth: where it is reached (mm). It does
    not relax.
    """

    stiffness: Any
    depth: Any
    name: ClassVar[str] = "second_contact"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 5
    units: ClassVar[dict[str, str]] = {"stiffness": "stiffness", "depth": "displacement"}
    null: ClassVar[dict[str, float]] = {"stiffness": 0.0}
    law: ClassVar[str] = "F += stiffness max(delta - depth, 0)"
    seen: ClassVar[str] = "stiffer at once beyond a depth, at any speed, also after long holds"
    reference: ClassVar[str] = "Gibson & Ashby 1997, Cellular Solids, ch. 5, densification"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Stiffness scaled by half of the depth, in which the second spring begins anywhere."""
        low, high = (share * scales.depth for share in _RANGE)
        return cls(scales.positive(0.5 * scales.depth), Uniform(low, high))

    def force(self, below: Law, motion: Motion) -> Array:
        """Add the second spring."""
        return below.force(motion) + self._spring(motion.displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Add the second spring."""
        state, force = below.step(state, line)
        return state, force + self._spring(line.displacement)

    def _spring(self, depth: Array) -> Array:
        return self.stiffness * jnp.maximum(depth - self.depth, 0.0)
