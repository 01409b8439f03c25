"""Other forms of listed effects for which the package has no counterpart anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from qlvbayes.simulate.hidden.effect import Effect, Recipe, depth_of, film_of, peak_of, reach_of
from qlvbayes.simulate.hidden.mesh import Array, Path
from qlvbayes.simulate.hidden.pad_effects import film, slack

_TERMS = 12  # of the series of diffusion: the rest is below 1.5 % of the share, and faster
_SLICES = 15  # of a tilted platen, each with its own contact


@dataclass(frozen=True)
class CavitatingFilm(Effect):
    """F -> F + max(eta v / (1 - d/h)^3, -limit): a film that pushes in full but cannot pull.

    eta in N s/mm, h in mm; limit (N) is what the fluid bears before it cavitates.
    """

    name: ClassVar[str] = "cavitating_film"
    recipe: ClassVar[Recipe] = Recipe(
        "eta",
        0.001,
        per=peak_of,
        shape=lambda x: film_of(x) | {"limit": x.peak * x.even(0.005, 0.03)},
    )
    order: ClassVar[int] = 32
    family: ClassVar[str] = "squeeze_film/viscous_drag/power_law_drag"
    positive: ClassVar[tuple[str, ...]] = ("h",)

    eta: float
    h: float
    limit: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the film's force."""
        push = self.eta * path.velocity / film(path.depth, self.h) ** 3
        return force + np.maximum(push, -self.limit)


@dataclass(frozen=True)
class PoroelasticDiffusion(Effect):
    """G -> (1 - c) G + c sum_k 8/(pi k)^2 e^{-k^2 t/time}, k odd: a layer that drains through it.

    Falls like sqrt(t) at first (Terzaghi's consolidation; its first 12 terms, scaled to sum 1).
    """

    name: ClassVar[str] = "poroelastic_diffusion"
    recipe: ClassVar[Recipe] = Recipe("c", 0.1, 0.6, shape=lambda x: {"time": x.spread(0.3, 30.0)})
    order: ClassVar[int] = 10
    shares: ClassVar[tuple[str, ...]] = ("c",)
    family: ClassVar[str] = "extra_relaxation_mode/fluid_pressure"
    positive: ClassVar[tuple[str, ...]] = ("time",)

    c: float
    time: float

    def modes(self, shares: Array, rates: Array) -> tuple[Array, Array]:
        """Add the series."""
        k = 2.0 * np.arange(_TERMS) + 1.0
        added = self.c * k**-2 / np.sum(k**-2)
        return np.append((1.0 - self.c) * shares, added), np.append(rates, k**2 / self.time)


@dataclass(frozen=True)
class TiltedPlaten(Effect):
    """F -> F times the mean over the platen of the share in contact, s in 0..rise: d > s.

    share(d) = min(d / rise, 1): the contact runs across the pad while d < rise (mm), in 15 slices
    that each come in within a twentieth of the rise.
    """

    name: ClassVar[str] = "tilted_platen"
    recipe: ClassVar[Recipe] = Recipe("rise", 0.1, 1.0, depth_of)
    order: ClassVar[int] = 36
    family: ClassVar[str] = "contact_offset"

    rise: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Weaken the force while only some slices touch."""
        if self.rise == 0.0:
            return force
        starts = (np.arange(_SLICES) + 0.5) / _SLICES * self.rise
        width = self.rise / 20.0
        share = np.zeros_like(path.depth)
        for start in starts:
            share += 0.5 * (1.0 + np.tanh((path.depth - start) / width)) / _SLICES
        return force * share


@dataclass(frozen=True)
class RootLeak(Effect):
    """F -> F (1 - min(k sqrt(t), 0.95)), t the clock: fluid lost by diffusion; k in 1/sqrt(s)."""

    name: ClassVar[str] = "root_leak"
    recipe: ClassVar[Recipe] = Recipe("k", 0.05, 5.0, lambda x: x.study_s**-0.5)
    order: ClassVar[int] = 21
    family: ClassVar[str] = "fluid_leak"

    k: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Weaken with the clock."""
        return force * (1.0 - np.minimum(self.k * np.sqrt(path.clock), 0.95))


@dataclass(frozen=True)
class OneWayFriction(Effect):
    """F -> F + strength max(z, 0), z Dahl's state of the reach: a guide that drags inwards only."""

    name: ClassVar[str] = "one_way_friction"
    recipe: ClassVar[Recipe] = Recipe("strength", per=peak_of, shape=reach_of)
    order: ClassVar[int] = 34
    family: ClassVar[str] = "friction"
    positive: ClassVar[tuple[str, ...]] = ("reach",)

    strength: float
    reach: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the friction of the way in."""
        return force + self.strength * np.maximum(path.slide(self.reach), 0.0)


@dataclass(frozen=True)
class HealingSoftening(Effect):
    """F -> F (1 - s (1 - d/dmax) y), y' = (x - y)/time, x = 1 - d/dmax: softening with delay."""

    name: ClassVar[str] = "healing_softening"
    recipe: ClassVar[Recipe] = Recipe("s", 0.3, 0.9, shape=lambda x: {"time": x.spread(0.3, 10.0)})
    order: ClassVar[int] = 20
    shares: ClassVar[tuple[str, ...]] = ("s",)
    family: ClassVar[str] = "stress_softening"
    positive: ClassVar[tuple[str, ...]] = ("time",)

    s: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Soften below the largest depth, late."""
        lost = slack(path)
        return force * (1.0 - self.s * lost * path.follow(1.0 / self.time, lost))
