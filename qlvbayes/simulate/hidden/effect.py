"""Define what every hidden effect can do, and how its parameters are drawn for a chosen size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from math import exp, inf, log
from typing import Any, ClassVar

import numpy as np

from qlvbayes.io.checks import InputError

from ..platen import Step, paper_protocol
from .mesh import Array, Path

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


Protocol = Callable[[float], tuple[Step, ...]]


@dataclass(frozen=True)
class Draw:
    """Quantities that the parameters are drawn from."""

    rng: np.random.Generator  # source of all randomness
    peak: float  # largest force of the pad in the study, N
    depth: float  # largest depth, mm
    rates: tuple[float, ...]  # those of the pad's own relaxation, 1/s
    study_s: float  # length of the study, s

    def even(self, low: float, high: float) -> float:
        """Uniform between two bounds."""
        return float(self.rng.uniform(low, high))

    def spread(self, low: float, high: float) -> float:
        """Log-uniform between two bounds."""
        return exp(self.rng.uniform(log(low), log(high)))

    def rate(self) -> float:
        """Rate of relaxation in 0.03 to 60 1/s, a factor 3 or more from the pad's own."""
        for _ in range(1000):
            rate = self.spread(0.03, 60.0)
            if all(abs(log(rate / own)) >= log(3.0) for own in self.rates):
                return rate
        raise InputError(f"no rate is far from {self.rates} 1/s")

    def seed(self) -> int:
        """Seed of an effect that is itself random."""
        return int(self.rng.integers(2**31))


@dataclass(frozen=True)
class Recipe:
    """Recipe by which an effect is drawn: its shape, and the parameter that sets its size.

    `guess` in the units of `per`: 'peak' (N), 'depth' (mm) or 1; `cap` likewise. `known` gives the
    parameter of a size outright, where no trial is needed.
    """

    size: str
    guess: float = 0.05
    cap: float = np.inf
    per: Callable[[Draw], float] = lambda draw: 1.0
    shape: Callable[[Draw], dict[str, Any]] = lambda draw: {}
    protocols: tuple[Protocol, ...] = field(default=(paper_protocol,))
    known: Callable[[Draw, float], float] | None = None


def peak_of(draw: Draw) -> float:
    """Unit of a force: the peak force, N."""
    return draw.peak


def depth_of(draw: Draw) -> float:
    """Unit of a length: the largest depth, mm."""
    return draw.depth


def per_depth(draw: Draw) -> float:
    """Unit of an exponent: one over the largest depth, 1/mm."""
    return 1.0 / draw.depth


def stiffness_of(draw: Draw) -> float:
    """Unit of a stiffness: peak force over depth, N/mm."""
    return draw.peak / draw.depth


def film_of(draw: Draw) -> dict[str, Any]:
    """Return the thickness of a film, 1.3 to 3 depths."""
    return {"h": draw.depth * draw.even(1.3, 3.0)}


def reach_of(draw: Draw) -> dict[str, Any]:
    """Way over which friction turns around, a small part of the depth."""
    return {"reach": draw.depth * draw.spread(0.01, 0.06)}
