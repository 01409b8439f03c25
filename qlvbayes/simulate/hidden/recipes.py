"""Define how a hidden effect's parameters are drawn, such that it has a chosen size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp, log
from typing import Any

import numpy as np

from qlvbayes.io.checks import InputError

from ..platen import Step, paper_protocol

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
