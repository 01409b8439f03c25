"""Other forms of the same physics: what a pad may do instead of the law in the list."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.optimize import nnls

from qlvbayes.simulate.hidden.contact_effects import Adhesion, FrameCompliance
from qlvbayes.simulate.hidden.effect import (
    Effect,
    Recipe,
    depth_of,
    film_of,
    peak_of,
    per_depth,
    reach_of,
    stiffness_of,
)
from qlvbayes.simulate.hidden.mesh import Array, Path
from qlvbayes.simulate.hidden.pad_effects import film, slack
from qlvbayes.simulate.platen import full_retraction_protocol, pull_off_protocol

_NEWTON_ROUNDS = 60  # at most, until the pressure stays within 1e-11 of its scale
_STRETCHED_DECADES = (-4.0, 4.0)  # of rates (1/s), from slower than a session to a sample
_STRETCHED_TERMS = 33  # four a decade
_ALL_TORN = 3.0  # stretches


@dataclass(frozen=True)
class GrowingDrag(Effect):
    """F -> F + eta (1 + d / depth) v; eta in N s/mm, depth in mm."""

    name: ClassVar[str] = "growing_drag"
    recipe: ClassVar[Recipe] = Recipe(
        "eta", 0.002, per=peak_of, shape=lambda x: {"depth": x.depth * x.even(0.2, 1.0)}
    )
    order: ClassVar[int] = 30
    family: ClassVar[str] = "viscous_drag/squeeze_film/power_law_drag"
    positive: ClassVar[tuple[str, ...]] = ("depth",)

    eta: float
    depth: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the drag."""
        return force + self.eta * (1.0 + path.depth / self.depth) * path.velocity


@dataclass(frozen=True)
class SteepSqueezeFilm(Effect):
    """F -> F + eta v / max(1 - d/h, 0.05)^1.5; eta in N s/mm, h in mm."""

    name: ClassVar[str] = "steep_squeeze_film"
    recipe: ClassVar[Recipe] = Recipe("eta", 0.001, per=peak_of, shape=film_of)
    order: ClassVar[int] = 32
    family: ClassVar[str] = "squeeze_film/viscous_drag/power_law_drag"
    positive: ClassVar[tuple[str, ...]] = ("h",)

    eta: float
    h: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the film's force."""
        return force + self.eta * path.velocity / film(path.depth, self.h) ** 1.5


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """F -> F + mu F z, with Dahl's z of the reach (mm) and F the force beneath."""

    name: ClassVar[str] = "coulomb_friction"
    recipe: ClassVar[Recipe] = Recipe("mu", 0.05, 0.9, shape=reach_of)
    order: ClassVar[int] = 34
    family: ClassVar[str] = "friction"
    positive: ClassVar[tuple[str, ...]] = ("reach",)

    mu: float
    reach: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add friction in proportion to the pressing force."""
        return force + self.mu * np.maximum(force, 0.0) * path.slide(self.reach)


@dataclass(frozen=True)
class ExponentialSoftening(Effect):
    """F -> F (1 - s (1 - e^{-k (1 - d/dmax)}) / (1 - e^{-k}))."""

    name: ClassVar[str] = "exponential_softening"
    recipe: ClassVar[Recipe] = Recipe(
        "s",
        0.3,
        0.9,
        shape=lambda draw: {"k": draw.even(1.0, 5.0)},
        protocols=(full_retraction_protocol,),
    )
    order: ClassVar[int] = 20
    shares: ClassVar[tuple[str, ...]] = ("s",)
    family: ClassVar[str] = "stress_softening"
    positive: ClassVar[tuple[str, ...]] = ("k",)

    s: float
    k: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Soften below the largest depth."""
        return force * (1.0 - self.s * np.expm1(-self.k * slack(path)) / np.expm1(-self.k))


@dataclass(frozen=True)
class SaturatingLeak(Effect):
    """F -> F (1 - share (1 - e^{-t/time})), t the clock; time in s."""

    name: ClassVar[str] = "saturating_leak"
    recipe: ClassVar[Recipe] = Recipe(
        "share", 0.08, 0.9, shape=lambda x: {"time": x.study_s * x.even(0.05, 0.4)}
    )
    order: ClassVar[int] = 21
    shares: ClassVar[tuple[str, ...]] = ("share",)
    family: ClassVar[str] = "fluid_leak"
    positive: ClassVar[tuple[str, ...]] = ("time",)

    share: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Weaken with the clock, down to 1 - share."""
        return force * (1.0 + self.share * np.expm1(-path.clock / self.time))


@dataclass(frozen=True)
class SaturatingDrift(Effect):
    """F -> F + offset (1 - e^{-t/time}), t the clock; N of either sign, s."""

    name: ClassVar[str] = "saturating_drift"
    recipe: ClassVar[Recipe] = Recipe(
        "offset", per=peak_of, shape=lambda x: {"time": x.study_s * x.even(0.05, 0.4)}
    )
    order: ClassVar[int] = 62
    family: ClassVar[str] = "force_drift"
    positive: ClassVar[tuple[str, ...]] = ("time",)
    signed: ClassVar[tuple[str, ...]] = ("offset",)

    offset: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Shift the force with the clock, up to the offset."""
        return force - self.offset * np.expm1(-path.clock / self.time)


@dataclass(frozen=True)
class Toe(Effect):
    """F -> F (1 - e^{-d/depth}): the area of contact grows at first; depth in mm."""

    name: ClassVar[str] = "toe"
    recipe: ClassVar[Recipe] = Recipe("depth", 0.1, 1.0, depth_of)
    order: ClassVar[int] = 36
    family: ClassVar[str] = "contact_offset"

    depth: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Weaken the force while the contact is small."""
        if self.depth == 0.0:
            return force
        return -force * np.expm1(-np.maximum(path.depth, 0.0) / self.depth)


@dataclass(frozen=True)
class ChannelLowPass(Effect):
    """time y' = F - y: the force channel lags behind at first order; time in s."""

    name: ClassVar[str] = "channel_low_pass"
    recipe: ClassVar[Recipe] = Recipe("time", 1e-3, 0.1)
    remembers: ClassVar[bool] = True
    order: ClassVar[int] = 69
    family: ClassVar[str] = "channel_lag"

    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Smooth the force."""
        return force if self.time == 0.0 else path.follow(1.0 / self.time, force)


@dataclass(frozen=True)
class StretchedRelaxation(Effect):
    """G -> (1 - c) G + c e^{-(t/time)^exponent}, as a sum of Prony modes; time in s."""

    name: ClassVar[str] = "stretched_relaxation"
    recipe: ClassVar[Recipe] = Recipe(
        "c", 0.1, 0.6, shape=lambda x: {"time": 1.0 / x.rate(), "exponent": x.even(0.3, 0.7)}
    )
    order: ClassVar[int] = 10
    shares: ClassVar[tuple[str, ...]] = ("c",)
    family: ClassVar[str] = "extra_relaxation_mode"
    positive: ClassVar[tuple[str, ...]] = ("time", "exponent")

    c: float
    time: float
    exponent: float

    def modes(self, shares: Array, rates: Array) -> tuple[Array, Array]:
        """Add the modes that together fall like the stretched exponential."""
        weights, spread = self._spectrum
        added = self.c * weights
        return np.concatenate([(1.0 - self.c) * shares, added]), np.append(rates, spread)

    @cached_property
    def _spectrum(self) -> tuple[Array, Array]:
        """Weights and rates (1/s) with sum 1, none below 0, by least squares over time."""
        rates = np.logspace(*_STRETCHED_DECADES, _STRETCHED_TERMS)[::-1]
        times = np.append(0.0, np.logspace(-4.5, 3.0, 200))
        matrix = np.exp(-np.outer(times, rates))
        weights, _ = nnls(matrix, np.exp(-(times**self.exponent)))
        kept = weights > 1e-6
        return weights[kept] / weights[kept].sum(), rates[kept] / self.time


@dataclass(frozen=True)
class QuadraticPressure(Effect):
    """F -> F + p, dp/dt = k v - drain p |p|, p = 0 at first; k in N/mm, drain in 1/(N s).

    Solved for what has drained, u = k d - p, by Newton's method along the whole test.
    """

    name: ClassVar[str] = "quadratic_pressure"
    recipe: ClassVar[Recipe] = Recipe(
        "k", 0.05, 5.0, stiffness_of, lambda x: {"drain": x.spread(10.0, 300.0) / x.peak}
    )
    order: ClassVar[int] = 33
    family: ClassVar[str] = "fluid_pressure"

    k: float
    drain: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the pressure."""
        return force + self._pressure(path)

    def _pressure(self, path: Path) -> Array:
        undrained = self.k * path.depth
        p = undrained - undrained[0, 0]
        scale = float(np.abs(p).max())
        for _ in range(_NEWTON_ROUNDS):
            # drain p|p| along its tangent: 2 drain |p| times (p + change - p / 2)
            rate = 2.0 * self.drain * np.abs(p)
            drained = path.follow(rate, undrained - 0.5 * p, start=float(undrained[0, 0]))
            change = undrained - drained - p
            p = p + change
            if np.abs(change).max() <= 1e-11 * scale:
                return p
        raise RuntimeError("the simulation stopped: the pressure finds no balance")


@dataclass(frozen=True)
class LinearRate(Effect):
    """v_i -> v_i max(1 + alpha d, 0.02) for all modes; alpha in 1/mm, either sign."""

    name: ClassVar[str] = "linear_rate"
    recipe: ClassVar[Recipe] = Recipe("alpha", 0.3, 20.0, per_depth)
    order: ClassVar[int] = 11
    family: ClassVar[str] = "strain_dependent_rate"
    signed: ClassVar[tuple[str, ...]] = ("alpha",)

    alpha: float

    def rate_factor(self, depth: Array) -> Array:
        """Factor 1 + alpha d, kept above 0."""
        return np.maximum(1.0 + self.alpha * depth, 0.02)


@dataclass(frozen=True)
class BendingFrame(FrameCompliance):
    """d -> d - compliance F / (1 + F / force): a frame that stiffens; mm/N, N.

    As with frame_compliance, drags take the platen's velocity.
    """

    name: ClassVar[str] = "bending_frame"
    recipe: ClassVar[Recipe] = Recipe(
        "compliance",
        0.05,
        1.0,
        lambda x: x.depth / x.peak,
        lambda x: {"force": x.peak * x.even(0.3, 1.5)},
    )
    family: ClassVar[str] = "frame_compliance"
    positive: ClassVar[tuple[str, ...]] = ("force",)

    force: float

    def deflection(self, force: Array) -> Array:
        """Return how far the frame yields, mm; to tension as to the same pressure."""
        return self.compliance * force / (1.0 + np.abs(force) / self.force)


@dataclass(frozen=True)
class AdhesionAtAStretch(Adhesion):
    """Tension T -> g max(T, strength e^(1/8) x/stretch), g = e^(-(X/stretch)^8/8); N, mm.

    Ligaments between platen and pad: x is how far the platen is off the surface, X the farthest
    since it touched, T the tension of adhesion. They obey g' = -(X/stretch)^7 X' g / stretch.
    """

    name: ClassVar[str] = "adhesion_at_a_stretch"
    recipe: ClassVar[Recipe] = Recipe(
        "strength",
        per=peak_of,
        cap=1.0,
        shape=lambda x: {"stretch": x.depth * x.even(0.03, 0.15)},
        protocols=(pull_off_protocol,),
    )
    family: ClassVar[str] = "adhesion"
    positive: ClassVar[tuple[str, ...]] = ("stretch",)

    stretch: float

    def kinks(self, largest: Array) -> Array:
        """Return where ligaments begin to pull, pull most, and are torn."""
        return self.stretch * np.array([0.0, -0.8, -1.0, -1.2])

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the ligaments' pull."""
        off = np.maximum(-path.platen.displacement(path.time), 0.0)
        far = np.minimum(_farthest_off(off) / self.stretch, _ALL_TORN)
        holding, pull = np.exp(-(far**8) / 8.0), np.minimum(off / self.stretch, _ALL_TORN)
        sticking = super().on_force(force, path)
        tension = np.minimum(np.minimum(sticking, 0.0), -self.strength * np.exp(1.0 / 8.0) * pull)
        return np.maximum(sticking, 0.0) + holding * tension


def _farthest_off(off: Array) -> Array:
    """Return how far the platen has been off the surface since it last touched, along nodes."""
    farthest, values = 0.0, []
    for x in off.ravel().tolist():
        farthest = max(farthest, x) if x > 0.0 else 0.0
        values.append(farthest)
    return np.array(values).reshape(off.shape)
