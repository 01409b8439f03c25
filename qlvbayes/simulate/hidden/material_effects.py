"""Effects in the material: how it relaxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .effect import Effect
from .mesh import Array
from .path import Path


@dataclass(frozen=True)
class ExtraRelaxationMode(Effect):
    """G -> (1 - c) G + c e^{-v t}; v in 1/s."""

    name: ClassVar[str] = "extra_relaxation_mode"
    order: ClassVar[int] = 10
    shares: ClassVar[tuple[str, ...]] = ("c",)
    positive: ClassVar[tuple[str, ...]] = ("v",)

    c: float
    v: float

    def modes(self, shares: Array, rates: Array) -> tuple[Array, Array]:
        """One more mode; the others shrink to leave it room."""
        return np.append((1.0 - self.c) * shares, self.c), np.append(rates, self.v)


@dataclass(frozen=True)
class StrainDependentRate(Effect):
    """v_i -> v_i e^{alpha d} for all modes; alpha in 1/mm."""

    name: ClassVar[str] = "strain_dependent_rate"
    order: ClassVar[int] = 11
    signed: ClassVar[tuple[str, ...]] = ("alpha",)

    alpha: float

    def rate_factor(self, depth: Array) -> Array:
        """Factor e^{alpha d}."""
        return np.exp(self.alpha * depth)


@dataclass(frozen=True)
class StrainDependentStrength(Effect):
    """F -> (1 - s) F + s F_e(d), s = 1 - e^{-beta d}; beta in 1/mm, F_e = m/b (e^{b d} - 1)."""

    name: ClassVar[str] = "strain_dependent_strength"
    order: ClassVar[int] = 12
    signed: ClassVar[tuple[str, ...]] = ("beta",)

    beta: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Mix the relaxing force with the elastic one."""
        share = -np.expm1(-self.beta * path.depth)
        return force + share * (path.elastic - force)
