"""Time cut into cells, equations solved on them, and what a pad goes through at their nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..motion import Motion

Array = NDArray[np.float64]

_ROOT6 = np.sqrt(6.0)
_NODES = np.array([0.0, (4 - _ROOT6) / 10, (4 + _ROOT6) / 10, 1.0])
_RADAU = np.array(
    [
        [(88 - 7 * _ROOT6) / 360, (296 - 169 * _ROOT6) / 1800, (-2 + 3 * _ROOT6) / 225],
        [(296 + 169 * _ROOT6) / 1800, (88 + 7 * _ROOT6) / 360, (-2 - 3 * _ROOT6) / 225],
        [(16 - _ROOT6) / 36, (16 + _ROOT6) / 36, 1 / 9],
    ]
)
_FIRST_CELL = 1e-6  # share of a stretch


@dataclass(frozen=True)
class Mesh:
    """Cells between ascending `edges` (s), each with its start and the three nodes of Radau IIA."""

    edges: Array

    @cached_property
    def steps(self) -> Array:
        """Length of each cell, s."""
        return np.diff(self.edges)

    @cached_property
    def time(self) -> Array:
        """Times of the nodes, s, shape (cells, 4)."""
        time = self.edges[:-1, None] + self.steps[:, None] * _NODES
        time[:, -1] = self.edges[1:]
        return time

    def at(self, values: Array, times: Array) -> Array:
        """Pick the values at `times`, which must be edges; right limits, left at the last edge."""
        cell = np.searchsorted(self.edges, times)
        return np.append(values[:, 0], values[-1, -1])[cell]

    def follow(self, rate: Array, target: Array, start: float) -> Array:
        """Solve y' = rate (target - y), y(0) = start, by collocation of order 5 in every cell."""
        z = self.steps[:, None] * rate[:, 1:]
        matrix = np.eye(3) + _RADAU * z[:, None, :]
        right = np.ones((z.shape[0], 3, 2))
        right[..., 1] = (z * target[:, 1:]) @ _RADAU.T
        solved: Array = np.linalg.solve(matrix, right).astype(np.float64, copy=False)
        gain, part = solved[..., 0], solved[..., 1]
        starts = recur(gain[:, -1], part[:, -1], start)[:-1]
        return np.column_stack([starts, part + gain * starts[:, None]])


def recur(gain: Array, part: Array, start: float) -> Array:
    """Return the values of y_(k+1) = gain_k y_k + part_k from y_0 = start; one more than gains."""
    y = start
    values = [y]
    for g, p in zip(gain.tolist(), part.tolist(), strict=True):
        y = g * y + p
        values.append(y)
    return np.array(values)


def graded(breaks: Array, cells: int) -> Array:
    """Return edges of about `cells` cells in each stretch between breaks, fine towards its ends."""
    half = np.geomspace(_FIRST_CELL, 0.5, max(cells // 3, 4))
    even = np.linspace(0.0, 1.0, max(cells // 3, 4))
    shape = np.unique(np.concatenate([half, 1.0 - half, even]))[:-1]
    inner = breaks[:-1, None] + np.diff(breaks)[:, None] * shape
    return np.append(inner.ravel(), breaks[-1])


@dataclass(frozen=True)
class Path:
    """Depth and velocity of the pad along a test, all of shape (cells, 4), in mm, N and s."""

    platen: Motion
    mesh: Mesh
    # depth, velocity: those of the pad, as the contact lets them through
    depth: Array
    velocity: Array
    elastic: Array  # force of an infinitely fast test to this depth, N

    @property
    def time(self) -> Array:
        """Seconds since the test began."""
        return self.mesh.time

    @property
    def clock(self) -> Array:
        """Seconds since the pad's first test began."""
        return self.platen.start_s + self.mesh.time

    @property
    def acceleration(self) -> Array:
        """Acceleration of the platen, mm/s2: constant in every cell, 0 after the end."""
        middle = self.platen.acceleration(0.5 * (self.mesh.edges[:-1] + self.mesh.edges[1:]))
        return np.broadcast_to(middle[:, None], self.time.shape)

    @cached_property
    def deepest(self) -> Array:
        """Largest depth so far in this test, mm."""
        return running_max(self.depth)

    def follow(self, rate: Array | float, target: Array, start: float | None = None) -> Array:
        """Y' = rate (target - y); from rest, y = target, unless `start` says otherwise."""
        rates = np.broadcast_to(np.asarray(rate, dtype=np.float64), target.shape)
        return self.mesh.follow(rates, target, float(target[0, 0]) if start is None else start)

    def slide(self, reach: float) -> Array:
        """Dahl's z: dz = (dd / reach)(1 - z sgn dd), z = 0 at first; exact where d is monotone."""
        travel = np.diff(self.depth.ravel())
        memory = np.exp(-np.abs(travel) / reach)
        push = -np.sign(travel) * np.expm1(-np.abs(travel) / reach)
        return recur(memory, push, 0.0).reshape(self.depth.shape)


def running_max(values: Array) -> Array:
    """Largest value so far along the nodes."""
    return np.maximum.accumulate(values.ravel()).reshape(values.shape)
