"""Effects in the pad: how it relaxes, softening, leaks, drags, pressure, friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..platen import full_retraction_protocol
from .effect import Effect, Recipe, film_of, peak_of, per_depth, reach_of, stiffness_of
from .mesh import Array, Path


@dataclass(frozen=True)
class ExtraRelaxationMode(Effect):
    """G -> (1 - c) G + c e^{-v t}; v in 1/s."""

    name: ClassVar[str] = "extra_relaxation_mode"
    recipe: ClassVar[Recipe] = Recipe("c", 0.1, 0.6, shape=lambda x: {"v": x.rate()})
    order: ClassVar[int] = 10
    shares: ClassVar[tuple[str, ...]] = ("c",)
    positive: ClassVar[tuple[str, ...]] = ("v",)

    c: float
    v: float

    def modes(self, shares: Array, rates: Array) -> tuple[Array, Array]:
        return np.append((1.0 - self.c) * shares, self.c), np.append(rates, self.v)


@dataclass(frozen=True)
class StrainDependentRate(Effect):
    """v_i -> v_i e^{alpha d} for all modes; alpha in 1/mm."""

    name: ClassVar[str] = "strain_dependent_rate"
    recipe: ClassVar[Recipe] = Recipe("alpha", 0.3, 5.0, per_depth)
    order: ClassVar[int] = 11
    signed: ClassVar[tuple[str, ...]] = ("alpha",)

    alpha: float

    def rate_factor(self, depth: Array) -> Array:
        return np.exp(self.alpha * depth)


@dataclass(frozen=True)
class StrainDependentStrength(Effect):
    """F -> (1 - s) F + s F_e(d), s = 1 - e^{-beta d}; beta in 1/mm, F_e = m/b (e^{b d} - 1)."""

    name: ClassVar[str] = "strain_dependent_strength"
    recipe: ClassVar[Recipe] = Recipe("beta", 0.1, 2.0, per_depth)
    order: ClassVar[int] = 12
    signed: ClassVar[tuple[str, ...]] = ("beta",)

    beta: float

    def on_force(self, force: Array, path: Path) -> Array:
        share = -np.expm1(-self.beta * path.depth)
        return force + share * (path.elastic - force)


_THINNEST = 0.05  # a squeezed film keeps this share of its thickness


@dataclass(frozen=True)
class StressSoftening(Effect):
    """F -> F (1 - s (1 - d/dmax)), dmax the largest depth so far in the test."""

    name: ClassVar[str] = "stress_softening"
    recipe: ClassVar[Recipe] = Recipe("s", 0.3, 0.9, protocols=(full_retraction_protocol,))
    order: ClassVar[int] = 20
    shares: ClassVar[tuple[str, ...]] = ("s",)

    s: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force * (1.0 - self.s * slack(path))


@dataclass(frozen=True)
class FluidLeak(Effect):
    """F -> F e^{-rate t}, t the clock since the pad's first test began; rate in 1/s."""

    name: ClassVar[str] = "fluid_leak"
    recipe: ClassVar[Recipe] = Recipe("rate", 0.05, 10.0, lambda x: 1.0 / x.study_s)
    order: ClassVar[int] = 21

    rate: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force * np.exp(-self.rate * path.clock)


@dataclass(frozen=True)
class Thixotropy(Effect):
    """F -> F (1 - share (1 - x)), x' = (1 - x)/time - |v| x / way: broken by motion, heals at rest.

    x = 1 at first; time in s, way in mm.
    """

    name: ClassVar[str] = "thixotropy"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.1,
        0.9,
        shape=lambda x: {"time": x.spread(2.0, 60.0), "way": x.depth * x.even(0.2, 1.0)},
    )
    order: ClassVar[int] = 23
    shares: ClassVar[tuple[str, ...]] = ("share",)
    positive: ClassVar[tuple[str, ...]] = ("time", "way")

    share: float
    time: float
    way: float

    def on_force(self, force: Array, path: Path) -> Array:
        rate = 1.0 / self.time + np.abs(path.velocity) / self.way
        whole = path.follow(rate, 1.0 / (self.time * rate), start=1.0)
        return force * (1.0 - self.share * (1.0 - whole))


@dataclass(frozen=True)
class Conditioning(Effect):
    """F -> F (1 - share (1 - e^{-n/tests})), n the number of the pad's tests before this one."""

    name: ClassVar[str] = "conditioning"
    recipe: ClassVar[Recipe] = Recipe(
        "share", 0.08, 0.9, shape=lambda x: {"tests": x.even(0.5, 3.0)}
    )
    order: ClassVar[int] = 25
    shares: ClassVar[tuple[str, ...]] = ("share",)
    positive: ClassVar[tuple[str, ...]] = ("tests",)

    share: float
    tests: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force * (1.0 - self.share * (1.0 - np.exp(-path.platen.number / self.tests)))


@dataclass(frozen=True)
class ViscousDrag(Effect):
    """F -> F + eta v; eta in N s/mm."""

    name: ClassVar[str] = "viscous_drag"
    recipe: ClassVar[Recipe] = Recipe("eta", 0.002, per=peak_of)
    order: ClassVar[int] = 30

    eta: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.eta * path.velocity


@dataclass(frozen=True)
class PowerLawDrag(Effect):
    """F -> F + k |v / (1 mm/s)|^n sgn v; k in N, 0 < n <= 1."""

    name: ClassVar[str] = "power_law_drag"
    recipe: ClassVar[Recipe] = Recipe(
        "k", 0.01, per=peak_of, shape=lambda x: {"n": x.even(0.3, 0.8)}
    )
    order: ClassVar[int] = 31
    shares: ClassVar[tuple[str, ...]] = ("n",)
    positive: ClassVar[tuple[str, ...]] = ("n",)

    k: float
    n: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.k * np.sign(path.velocity) * np.abs(path.velocity) ** self.n


@dataclass(frozen=True)
class SqueezeFilm(Effect):
    """F -> F + eta v / max(1 - d/h, 0.05)^3; eta in N s/mm, h in mm."""

    name: ClassVar[str] = "squeeze_film"
    recipe: ClassVar[Recipe] = Recipe("eta", 0.001, per=peak_of, shape=film_of)
    order: ClassVar[int] = 32
    positive: ClassVar[tuple[str, ...]] = ("h",)

    eta: float
    h: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.eta * path.velocity / film(path.depth, self.h) ** 3


@dataclass(frozen=True)
class FluidPressure(Effect):
    """F -> F + p, dp/dt = k v - (p / tau) e^{-a d}, p = 0 at first; k in N/mm, tau s, a 1/mm.

    Solved for what has drained, u = k d - p, as u' = e^{-a d} / tau (k d - u).
    """

    name: ClassVar[str] = "fluid_pressure"
    recipe: ClassVar[Recipe] = Recipe(
        "k",
        0.05,
        per=stiffness_of,
        shape=lambda draw: {"tau": draw.spread(0.1, 10.0), "a": draw.even(0.0, 1.0) / draw.depth},
    )
    order: ClassVar[int] = 33
    positive: ClassVar[tuple[str, ...]] = ("tau",)
    signed: ClassVar[tuple[str, ...]] = ("a",)

    k: float
    tau: float
    a: float

    def on_force(self, force: Array, path: Path) -> Array:
        undrained = self.k * path.depth
        return force + undrained - path.follow(np.exp(-self.a * path.depth) / self.tau, undrained)


@dataclass(frozen=True)
class Friction(Effect):
    """F -> F + strength z, dz/dt = (v / reach)(1 - z sgn v), z = 0 at first (Dahl); N, mm."""

    name: ClassVar[str] = "friction"
    recipe: ClassVar[Recipe] = Recipe("strength", per=peak_of, shape=reach_of)
    order: ClassVar[int] = 34
    positive: ClassVar[tuple[str, ...]] = ("reach",)

    strength: float
    reach: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.strength * path.slide(self.reach)


@dataclass(frozen=True)
class SecondContact(Effect):
    """F -> F + stiffness max(d - depth, 0); N/mm, mm."""

    name: ClassVar[str] = "second_contact"
    recipe: ClassVar[Recipe] = Recipe(
        "stiffness", 0.2, per=stiffness_of, shape=lambda x: {"depth": x.depth * x.even(0.4, 0.8)}
    )
    order: ClassVar[int] = 35

    stiffness: float
    depth: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.stiffness * np.maximum(path.depth - self.depth, 0.0)


def film(depth: Array, thickness: float) -> Array:
    """Share of its thickness that a film still has, at least 0.05."""
    return np.maximum(1.0 - depth / thickness, _THINNEST)


def slack(path: Path) -> Array:
    """1 - d/dmax, and 0 as long as dmax is 0."""
    pressed = path.deepest > 0.0
    return np.where(pressed, 1.0 - path.depth / np.where(pressed, path.deepest, 1.0), 0.0)
