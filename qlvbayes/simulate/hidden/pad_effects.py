"""Effects in the pad: how it relaxes, softening, leaks, drags, pressure, friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..platen import full_retraction_protocol
from .effect import Effect, Recipe, film_of, peak_of, per_depth, reach_of, stiffness_of
from .mesh import Array, Path


@dataclass(frozen=True)
class ExtraRelaxationMode(Effect):
    """G -> (1 - c) G + c e^{-v t}; v in 1/s."""

    name = "extra_relaxation_mode"
    recipe = Recipe("c", 0.1, 0.6, shape=lambda x: {"v": x.rate()})
    order = 10
    shares = ("c",)
    positive = ("v",)

    c: float
    v: float

    def modes(self, shares: Array, rates: Array) -> tuple[Array, Array]:
        return np.append((1.0 - self.c) * shares, self.c), np.append(rates, self.v)


@dataclass(frozen=True)
class StrainDependentRate(Effect):
    """v_i -> v_i e^{alpha d} for all modes; alpha in 1/mm."""

    name = "strain_dependent_rate"
    recipe = Recipe("alpha", 0.3, 5.0, per_depth)
    order = 11
    signed = ("alpha",)

    alpha: float

    def rate_factor(self, depth: Array) -> Array:
        return np.exp(self.alpha * depth)


@dataclass(frozen=True)
class StrainDependentStrength(Effect):
    """F -> (1 - s) F + s F_e(d), s = 1 - e^{-beta d}; beta in 1/mm, F_e = m/b (e^{b d} - 1)."""

    name = "strain_dependent_strength"
    recipe = Recipe("beta", 0.1, 2.0, per_depth)
    order = 12
    signed = ("beta",)

    beta: float

    def on_force(self, force: Array, path: Path) -> Array:
        share = -np.expm1(-self.beta * path.depth)
        return force + share * (path.elastic - force)


_THINNEST = 0.05  # a squeezed film keeps this share of its thickness


@dataclass(frozen=True)
class StressSoftening(Effect):
    """F -> F (1 - s (1 - d/dmax)), dmax the largest depth so far in the test."""

    name = "stress_softening"
    recipe = Recipe("s", 0.3, 0.9, protocols=(full_retraction_protocol,))
    order = 20
    shares = ("s",)

    s: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force * (1.0 - self.s * slack(path))


@dataclass(frozen=True)
class FluidLeak(Effect):
    """F -> F e^{-rate t}, t the clock since the pad's first test began; rate in 1/s."""

    name = "fluid_leak"
    recipe = Recipe("rate", 0.05, 10.0, lambda x: 1.0 / x.study_s)
    order = 21

    rate: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force * np.exp(-self.rate * path.clock)


@dataclass(frozen=True)
class Thixotropy(Effect):
    """F -> F (1 - share (1 - x)), x' = (1 - x)/time - |v| x / way: broken by motion, heals at rest.

    x = 1 at first; time in s, way in mm.
    """

    name = "thixotropy"
    recipe = Recipe(
        "share",
        0.1,
        0.9,
        shape=lambda x: {"time": x.spread(2.0, 60.0), "way": x.depth * x.even(0.2, 1.0)},
    )
    order = 23
    shares = ("share",)
    positive = ("time", "way")

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

    name = "conditioning"
    recipe = Recipe("share", 0.08, 0.9, shape=lambda x: {"tests": x.even(0.5, 3.0)})
    order = 25
    shares = ("share",)
    positive = ("tests",)

    share: float
    tests: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force * (1.0 - self.share * (1.0 - np.exp(-path.platen.number / self.tests)))


@dataclass(frozen=True)
class ViscousDrag(Effect):
    """F -> F + eta v; eta in N s/mm."""

    name = "viscous_drag"
    recipe = Recipe("eta", 0.002, per=peak_of)
    order = 30

    eta: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.eta * path.velocity


@dataclass(frozen=True)
class PowerLawDrag(Effect):
    """F -> F + k |v / (1 mm/s)|^n sgn v; k in N, 0 < n <= 1."""

    name = "power_law_drag"
    recipe = Recipe("k", 0.01, per=peak_of, shape=lambda x: {"n": x.even(0.3, 0.8)})
    order = 31
    shares = ("n",)
    positive = ("n",)

    k: float
    n: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.k * np.sign(path.velocity) * np.abs(path.velocity) ** self.n


@dataclass(frozen=True)
class SqueezeFilm(Effect):
    """F -> F + eta v / max(1 - d/h, 0.05)^3; eta in N s/mm, h in mm."""

    name = "squeeze_film"
    recipe = Recipe("eta", 0.001, per=peak_of, shape=film_of)
    order = 32
    positive = ("h",)

    eta: float
    h: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.eta * path.velocity / film(path.depth, self.h) ** 3


@dataclass(frozen=True)
class FluidPressure(Effect):
    """F -> F + p, dp/dt = k v - (p / tau) e^{-a d}, p = 0 at first; k in N/mm, tau s, a 1/mm.

    Solved for what has drained, u = k d - p, as u' = e^{-a d} / tau (k d - u).
    """

    name = "fluid_pressure"
    recipe = Recipe(
        "k",
        0.05,
        per=stiffness_of,
        shape=lambda draw: {"tau": draw.spread(0.1, 10.0), "a": draw.even(0.0, 1.0) / draw.depth},
    )
    order = 33
    positive = ("tau",)
    signed = ("a",)

    k: float
    tau: float
    a: float

    def on_force(self, force: Array, path: Path) -> Array:
        undrained = self.k * path.depth
        return force + undrained - path.follow(np.exp(-self.a * path.depth) / self.tau, undrained)


@dataclass(frozen=True)
class Friction(Effect):
    """F -> F + strength z, dz/dt = (v / reach)(1 - z sgn v), z = 0 at first (Dahl); N, mm."""

    name = "friction"
    recipe = Recipe("strength", per=peak_of, shape=reach_of)
    order = 34
    positive = ("reach",)

    strength: float
    reach: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.strength * path.slide(self.reach)


@dataclass(frozen=True)
class SecondContact(Effect):
    """F -> F + stiffness max(d - depth, 0); N/mm, mm."""

    name = "second_contact"
    recipe = Recipe(
        "stiffness", 0.2, per=stiffness_of, shape=lambda x: {"depth": x.depth * x.even(0.4, 0.8)}
    )
    order = 35

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
