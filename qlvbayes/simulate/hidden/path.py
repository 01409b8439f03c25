"""What a pad goes through in one test, at the nodes of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..motion import Motion
from .mesh import Array, Mesh, recur


@dataclass(frozen=True)
class Path:
    """Depth and velocity of the pad along a test, all of shape (cells, 4), in mm, N and s.

    Parameters
    ----------
    platen, mesh : the motion and the cells of time
    depth, velocity : of the pad, as the contact lets them through
    elastic : force of an infinitely fast test to this depth, N
    """

    platen: Motion
    mesh: Mesh
    depth: Array
    velocity: Array
    elastic: Array

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
