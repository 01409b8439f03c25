"""Effects in the load cell and its channel."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from .effect import Effect, Recipe, peak_of
from .mesh import Array, Path


@dataclass(frozen=True)
class FrameRinging(Effect):
    """F -> F + strength w / (2 pi f), w'' + 2 g w' + (g^2 + (2 pi f)^2)(w - a) = 0, w = w' = 0.

    g = 2 pi f damping: the response to each jump of the platen's acceleration a and of its speed,
    one added to the other; strength in N s/mm, frequency f in Hz.
    """

    name = "frame_ringing"
    recipe = Recipe(
        "strength",
        0.003,
        per=peak_of,
        shape=lambda x: {"frequency": x.spread(4.0, 25.0), "damping": x.spread(0.03, 0.2)},
    )
    order = 59
    positive = ("frequency",)

    strength: float
    frequency: float
    damping: float

    def on_force(self, force: Array, path: Path) -> Array:
        turn = 2.0 * pi * self.frequency
        added = np.zeros_like(force)
        speed = push = 0.0
        for piece in path.platen.pieces:
            since = path.time - piece.start
            swung = np.maximum(since, 0.0) * turn
            fading, sine = np.exp(-self.damping * swung), np.sin(swung)
            step = 1.0 - fading * (np.cos(swung) + self.damping * sine)
            knock = turn * (1.0 + self.damping**2) * fading * sine
            started = since >= 0.0
            jump = piece.velocity - speed
            added += np.where(started, (piece.acceleration - push) * step + jump * knock, 0.0)
            speed = piece.velocity + piece.acceleration * piece.duration
            push = piece.acceleration
        return force + self.strength / turn * added


@dataclass(frozen=True)
class Inertia(Effect):
    """F -> F + mass a, a the platen's acceleration; mass in N s2/mm."""

    name = "inertia"
    recipe = Recipe("mass", 5e-5, per=peak_of)
    order = 60

    mass: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.mass * path.acceleration


@dataclass(frozen=True)
class ForceOffset(Effect):
    """F -> F + offset; N, either sign."""

    name = "force_offset"
    recipe = Recipe("offset", per=peak_of)
    order = 61
    signed = ("offset",)

    offset: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.offset


@dataclass(frozen=True)
class ForceDrift(Effect):
    """F -> F + rate t, t the clock since the pad's first test began; N/s, either sign."""

    name = "force_drift"
    recipe = Recipe("rate", per=lambda x: x.peak / x.study_s)
    order = 62
    signed = ("rate",)

    rate: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.rate * path.clock


@dataclass(frozen=True)
class LoadCellCreep(Effect):
    """F -> F + share y, y' = (F - y)/time: the load cell's own after-effect; s."""

    name = "load_cell_creep"
    recipe = Recipe("share", 0.05, 0.9, shape=lambda x: {"time": x.spread(2.0, 60.0)})
    order = 67
    positive = ("time",)

    share: float
    time: float

    def on_force(self, force: Array, path: Path) -> Array:
        return force + self.share * path.follow(1.0 / self.time, force)


@dataclass(frozen=True)
class ChannelLag(Effect):
    """F(t) -> F(t - delay); before the start the force of the start; delay in s."""

    name = "channel_lag"
    recipe = Recipe("delay", 1e-3, 0.05)
    order = 69

    delay: float

    def late(self) -> float:
        return self.delay
