"""More effects outside of every list: no law, form or free curve of the package stands for them."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from .effect import Effect
from .mesh import Array, Path
from .recipes import Recipe, peak_of


@dataclass(frozen=True)
class ViscousHeating(Effect):
    """F -> F (1 - share T), T' = (|F v| / power - T) / time: the pad warms by what it dissipates.

    power in N mm/s, time in s; T is 1 where the power acts for long.
    """

    name: ClassVar[str] = "viscous_heating"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.1,
        0.9,
        shape=lambda x: {"power": x.peak * x.spread(0.5, 5.0), "time": x.spread(0.5, 20.0)},
    )
    order: ClassVar[int] = 22
    positive: ClassVar[tuple[str, ...]] = ("power", "time")

    share: float
    power: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Soften by the warmth."""
        heat = np.abs(force * path.velocity) / self.power
        warm = path.follow(1.0 / self.time, heat, start=0.0)
        return force * np.maximum(1.0 - self.share * warm, 0.05)


@dataclass(frozen=True)
class DriveRipple(Effect):
    """F -> F + amplitude sin(2 pi d / pitch) while the platen moves: the motor's current; N, mm."""

    name: ClassVar[str] = "drive_ripple"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude", per=peak_of, shape=lambda x: {"pitch": x.depth * x.even(0.1, 0.4)}
    )
    order: ClassVar[int] = 63
    positive: ClassVar[tuple[str, ...]] = ("pitch",)

    amplitude: float
    pitch: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the ripple; at rest the current is gone. Below 1e-3 mm/s the drive counts as idle."""
        position = path.platen.displacement(path.time)
        speed = np.abs(path.platen.velocity(path.time))
        driven = speed / (speed + 1e-3)
        return force + self.amplitude * driven * np.sin(2.0 * pi * position / self.pitch)


@dataclass(frozen=True)
class StickSlip(Effect):
    """F -> F + amplitude saw(s / pitch) sgn(way), s the way travelled; N, mm.

    saw rises from 0 to 1 over nine tenths of a pitch and falls in the rest; at rest it stays.
    """

    name: ClassVar[str] = "stick_slip"
    recipe: ClassVar[Recipe] = Recipe(
        "amplitude", per=peak_of, shape=lambda x: {"pitch": x.depth * x.even(0.08, 0.3)}
    )
    order: ClassVar[int] = 37
    positive: ClassVar[tuple[str, ...]] = ("pitch",)

    amplitude: float
    pitch: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Add the sawtooth."""
        travel = np.diff(path.depth.ravel(), prepend=path.depth.flat[0])
        phase = np.mod(np.cumsum(np.abs(travel)) / self.pitch, 1.0)
        saw = np.minimum(phase / 0.9, (1.0 - phase) / 0.1)
        direction = _last_way(travel)
        return force + self.amplitude * (saw * direction).reshape(force.shape)


@dataclass(frozen=True)
class SnapThrough(Effect):
    """F -> F - drop x, x in {0, 1}: a wall that buckles at `depth` going in, back at 0.8 depth.

    The state changes within 2 % of the depth, so that the force falls steeply, not at once; mm, N.
    """

    name: ClassVar[str] = "snap_through"
    recipe: ClassVar[Recipe] = Recipe(
        "drop", per=peak_of, shape=lambda x: {"depth": x.depth * x.even(0.4, 0.8)}
    )
    order: ClassVar[int] = 38
    positive: ClassVar[tuple[str, ...]] = ("depth",)

    drop: float
    depth: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Take away the wall's share."""
        width = 0.02 * self.depth
        rise = np.clip((path.depth - self.depth) / width, 0.0, 1.0).ravel()
        stay = np.clip((path.depth - 0.8 * self.depth) / width, 0.0, 1.0).ravel()
        state, states = 0.0, []
        for low, high in zip(rise.tolist(), stay.tolist(), strict=True):
            state = min(max(state, low), high)
            states.append(state)
        return force - self.drop * np.array(states).reshape(force.shape)


@dataclass(frozen=True)
class Curing(Effect):
    """F -> F (1 + share / (1 + e^{-(t - middle)/width})), t the clock: the material sets; s."""

    name: ClassVar[str] = "curing"
    recipe: ClassVar[Recipe] = Recipe(
        "share",
        0.1,
        shape=lambda x: {
            "middle": x.study_s * x.even(0.3, 0.7),
            "width": x.study_s * x.even(0.03, 0.1),
        },
    )
    order: ClassVar[int] = 24
    positive: ClassVar[tuple[str, ...]] = ("width",)

    share: float
    middle: float
    width: float

    def on_force(self, force: Array, path: Path) -> Array:
        """Stiffen with the clock."""
        return force * (1.0 + self.share / (1.0 + np.exp(-(path.clock - self.middle) / self.width)))


def _last_way(travel: Array) -> Array:
    """Sign of the last step that was one."""
    moved = np.where(travel != 0.0, np.arange(travel.size), 0)
    return np.sign(travel[np.maximum.accumulate(moved)])
