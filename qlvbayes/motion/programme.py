"""Planned motions: strokes from rest to rest with finite acceleration, and dwells between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from qlvbayes.motion.trajectory import Trajectory


@dataclass(frozen=True)
class Stroke:
    """A movement to ``target`` no faster than ``speed``, followed by a hold of ``hold`` seconds."""

    target: float
    speed: float
    hold: float


def planned(strokes: Sequence[Stroke], acceleration: float) -> Trajectory:
    """Return the motion of some strokes from zero displacement, each a trapezoid of velocity."""
    pieces: list[tuple[float, float, float]] = []  # duration, velocity at the start, acceleration
    position = 0.0
    for stroke in strokes:
        length = stroke.target - position
        position = stroke.target
        if length:
            pieces += _trapezoid(abs(length), stroke.speed, acceleration, np.sign(length))
        if stroke.hold > 0.0:
            pieces.append((stroke.hold, 0.0, 0.0))
    duration, velocity, rate = np.array(pieces).T
    knots = np.concatenate([[0.0], np.cumsum(duration)])
    gained = duration * (velocity + 0.5 * rate * duration)
    start = np.concatenate([[0.0], np.cumsum(gained)[:-1]])
    return Trajectory(knots, start, velocity, rate, 0.0)


def _trapezoid(
    length: float, speed: float, acceleration: float, sign: float
) -> list[tuple[float, float, float]]:
    top = min(speed, sqrt(acceleration * length))
    rise = top / acceleration
    cruise = length / top - rise
    cruising = [(cruise, sign * top, 0.0)] if cruise > 1e-12 * rise else []
    return [(rise, 0.0, sign * acceleration), *cruising, (rise, sign * top, -sign * acceleration)]
