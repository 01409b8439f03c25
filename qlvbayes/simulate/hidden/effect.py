"""Define what every hidden effect can do, and the order in which they act."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import inf
from typing import Any, ClassVar

import numpy as np

from qlvbayes.io.checks import InputError

from .mesh import Array, Path
from .recipes import Recipe

CONTACT = 45
"""Effects of lower order act on the pad; here the contact keeps the force from pulling."""
FRAME = 50
"""Effects of higher order act on what the load cell says."""


@dataclass(frozen=True)
class Effect:
    """A physical effect: it does nothing but where it overrides one of the methods.

    `order` is its position in the nesting, from the material (low) to the sensor (high).
    `family` names, for another form of the same physics, the effects it stands for, with '/'.
    `positive` and `signed` are the parameters that must be above 0 and may be negative; all
    others must be at least 0; `shares` are at most 1. An effect that `remembers` makes the past
    of the contact force count, so that the moment at which contact ends must be found. One that
    `slides` is of specimens that are held by their faces. `recipe` says how its parameters are
    drawn.
    """

    name: ClassVar[str] = ""
    order: ClassVar[int] = 0
    family: ClassVar[str] = ""
    positive: ClassVar[tuple[str, ...]] = ()
    signed: ClassVar[tuple[str, ...]] = ()
    shares: ClassVar[tuple[str, ...]] = ()
    remembers: ClassVar[bool] = False
    slides: ClassVar[bool] = False
    recipe: ClassVar[Recipe]

    def __post_init__(self) -> None:
        for key, value in self.parameters.items():
            low = -inf if key in self.signed else 0.0
            if not low <= value < inf or value == -inf or (key in self.positive and value == 0):
                kind = "finite" if key in self.signed else "at least 0"
                kind = "above 0" if key in self.positive else kind
                raise InputError(f"{key} of {self.name} must be {kind}, not {value}")
            if key in self.shares and value > 1.0:
                raise InputError(f"{key} of {self.name} must be at most 1, not {value}")

    @property
    def parameters(self) -> dict[str, Any]:
        """The effect's constants by name."""
        return asdict(self)

    def late(self) -> float:
        """Return the seconds by which the force comes late."""
        return 0.0

    def lost(self) -> float:
        """Depth that the contact takes away, mm."""
        return 0.0

    def modes(self, shares: Array, rates: Array) -> tuple[Array, Array]:
        """Return the shares (c0, c1, ...) and rates (v1, ...) of the relaxation."""
        return shares, rates

    def rate_factor(self, depth: Array) -> Array:
        """Factor on every relaxation rate."""
        return np.ones_like(depth)

    def on_depth(self, depth: Array, velocity: Array) -> tuple[Array, Array]:
        """Depth and velocity that the pad sees, from those that arrive."""
        return depth, velocity

    def kinks(self, largest: Array) -> Array:
        """Arriving depths at which on_depth is not smooth, given the largest depths so far."""
        return np.zeros(0)

    def on_force(self, force: Array, path: Path) -> Array:
        """Force with the effect, from the force of all that lies beneath."""
        return force

    def deflection(self, force: Array) -> Array:
        """Return how far the frame yields, mm."""
        return np.zeros_like(force)
