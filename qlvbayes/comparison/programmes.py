"""Motions from which quantities are read: steps, ramps, cycles, oscillations.

All have the same number of points, so that one compiled function serves them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

RAMP_POINTS = 129
HOLD_POINTS = 193
_DECADES = 6  # that the points of a hold span

CYCLES, REST_CYCLES = 3, 1
PIECES = 96  # of a cycle
AMPLITUDE = 0.01  # of a small oscillation, over the depth

POINTS = RAMP_POINTS + HOLD_POINTS + 2 * (CYCLES + REST_CYCLES) * PIECES + 1
BURST = slice(RAMP_POINTS + HOLD_POINTS, POINTS)
_INSTANT = 1e-6  # s, in which a step is made


@dataclass(frozen=True, eq=False)
class Course:
    """A motion (N,): time (s), depth (mm) and velocity (mm/s) just after each point."""

    time: np.ndarray
    depth: np.ndarray
    velocity: np.ndarray

    def filled(self) -> Course:
        """Return the motion padded to `POINTS` points at rest, which have no effect."""
        missing = POINTS - self.time.size
        time, depth = (np.pad(x, (0, missing), "edge") for x in (self.time, self.depth))
        return Course(time, depth, np.append(self.velocity, np.zeros(missing)))


def step_hold(depth: float, duration: float) -> Course:
    """Return a step of 1 us to ``depth`` (mm), then rest for ``duration`` (s)."""
    return ramp_hold(depth, depth / _INSTANT, duration)


def ramp_hold(depth: float, speed: float, duration: float) -> Course:
    """Return a ramp from contact to ``depth`` (mm) at ``speed`` (mm/s), then rest (s)."""
    up = ramp(0.0, 0.0, depth, speed)
    return joined([up, hold(up.time[-1], depth, duration)])


def cycle(depth: float, speed: float) -> Course:
    """Return a ramp from contact to ``depth`` and back at one speed."""
    up = ramp(0.0, 0.0, depth, speed)
    return joined([up, ramp(up.time[-1], depth, 0.0, speed)])


def oscillation(
    depth: float, speed: float, duration: float, frequency: float, amplitude: float
) -> Course:
    """Return a ramp, a hold and a burst of a sine (Hz) about ``depth`` in a Hann window."""
    before = ramp_hold(depth, speed, duration)
    phase = np.linspace(0.0, CYCLES + REST_CYCLES, (CYCLES + REST_CYCLES) * PIECES + 1)  # cycles
    window = np.where(phase <= CYCLES, np.sin(np.pi * phase / CYCLES) ** 2, 0.0)
    swing = amplitude * window * np.sin(2.0 * np.pi * phase)
    speeds = np.diff(swing, append=swing[-1]) * PIECES * frequency
    time = before.time[-1] + _with_middles(phase) / frequency
    burst = Course(time, depth + _with_middles(swing), np.repeat(speeds, 2)[:-1])
    return joined([before, burst])


def middles(values: np.ndarray) -> np.ndarray:
    """Return the values (..., N) of an oscillation at the middles of the burst's pieces."""
    return values[..., BURST][..., 1::2]


def _with_middles(ends: np.ndarray) -> np.ndarray:
    both = np.empty(2 * ends.size - 1)
    both[::2], both[1::2] = ends, 0.5 * (ends[1:] + ends[:-1])
    return both


def ramp(start: float, first: float, last: float, speed: float) -> Course:
    """Return a ramp that begins at ``start`` (s), from one depth to another."""
    share = np.linspace(0.0, 1.0, RAMP_POINTS)
    travel = last - first
    velocity = np.full(RAMP_POINTS, np.sign(travel) * speed)
    return Course(start + share * abs(travel) / speed, first + share * travel, velocity)


def hold(start: float, depth: float, duration: float) -> Course:
    """Return a hold whose points are even in the logarithm of time."""
    shares = np.concatenate([[0.0], np.geomspace(10.0**-_DECADES, 1.0, HOLD_POINTS - 1)])
    nothing = np.zeros(HOLD_POINTS)
    return Course(start + duration * shares, nothing + depth, nothing)


def joined(parts: Sequence[Course]) -> Course:
    """Join motions; at a kink both velocities are there, at the same time."""
    return Course(
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.depth for part in parts]),
        np.concatenate([part.velocity for part in parts]),
    )
