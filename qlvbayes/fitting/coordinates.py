r"""The coordinates in which a chain moves: theta, with the force at the best reading in it.

A stiffness k, the shape of the elastic law and the shares that relax all change the force at one
reading. Where that reading is much better than the others, as at the end of a hold in which noise
dies away, they lie on a thin, curved surface, which no straight step follows. With the logarithm of
the force that is left at its depth and time,

.. math:: u = \ln \left| g(t)\, F_e(\delta) \right| = \ln k + s(\text{the others}),

in place of ln k the surface is a plane. The map shears theta, so that the determinant of its
Jacobian is 1 and a density over the coordinates is the density over theta. Where the posterior is
thicker than it bends, the coordinates are theta itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import jax
import numpy as np

from qlvbayes.fitting.least_squares import NormalApproximation
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.inference.forward.fixedrates import relaxation_of
from qlvbayes.io.arrays import Array
from qlvbayes.motion.record import Record

_TRIALS = 64  # draws at which u is tried
_EXACT = 1e-9  # rounding of u
_STEP = 1e-5  # in theta's units of order one: of a shape that a Metropolis step corrects


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The map between theta (D,) and the coordinates of a chain."""

    posterior: Posterior
    # depth (mm) of the best reading, and its time (s) since the platen came half as far
    depth: float
    time: float
    # index of ln k in theta; None where u does not bend by more than its sd, or the elastic force
    # is not proportional to one free constant
    index: int | None

    @classmethod
    def from_posterior(cls, posterior: Posterior, start: NormalApproximation) -> Self:
        """Return the coordinates of a posterior; u is tried at draws of a normal approximation."""
        straight = cls(posterior, *best_reading(posterior.record), None)
        if posterior.size == 0:
            return straight
        near = straight._about(start.mean)
        some = start.draw(_TRIALS, np.random.default_rng(0))
        some = posterior.parameters.within(some)
        at_mean, *steps = straight._logs(near)
        logs, units = straight._logs(some), np.eye(posterior.size)
        if not np.isfinite([at_mean, *steps, *logs]).all():  # as with the platen off the specimen
            return straight
        slope = _slope(np.array([at_mean, *steps]))
        linear = at_mean + (some - start.mean) @ slope
        bends = float(np.mean((logs - linear) ** 2)) > float(slope @ start.covariance @ slope)
        follows = [
            bool(np.all(np.abs(straight._logs(some + unit) - logs - 1.0) < _EXACT))
            for unit in units
        ]
        return replace(straight, index=follows.index(True) if bends and any(follows) else None)

    def from_theta(self, theta: Array) -> Array:
        """Return coordinates (..., D) of theta (..., D)."""
        return theta if self.index is None else self._with_index(theta, self._logs(theta))

    def to_theta(self, coordinates: Array) -> Array:
        """Return theta (..., D) at coordinates (..., D)."""
        if self.index is None:
            return coordinates
        others = self._with_index(coordinates, np.zeros(coordinates.shape[:-1]))
        return self._with_index(coordinates, coordinates[..., self.index] - self._logs(others))

    def of_normal(self, normal: NormalApproximation) -> NormalApproximation:
        """Return the normal approximation over the coordinates, to first order at its mean."""
        if self.index is None:
            return normal
        jacobian = np.eye(self.posterior.size)
        jacobian[self.index] = _slope(self._logs(self._about(normal.mean)))
        return NormalApproximation(
            self.from_theta(normal.mean), jacobian @ normal.covariance @ jacobian.T
        )

    def _with_index(self, theta: Array, values: Array) -> Array:
        changed = np.array(theta)
        changed[..., self.index] = values
        return changed

    def _logs(self, theta: Array) -> Array:
        """Return ln |g(t) F_e(depth)| (...,) at theta (..., D)."""
        own = self.posterior.parameters
        constants = own.constants(theta.reshape(-1, own.size))
        law = own.model_at(constants.T)
        fractions, rates = self.posterior.space.spectra(self.posterior.hypothesis, constants)
        left = relaxation_of(fractions, rates, np.array([self.time]))[:, 0]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            (force,) = law.elastic.force(np.array([[self.depth]]))
            return np.log(np.abs(left * force)).reshape(theta.shape[:-1])

    def _about(self, theta: Array) -> Array:
        """Return theta (D,) and, below it, theta with a step along each of its numbers."""
        return theta + _STEP * np.vstack([np.zeros(theta.size), np.eye(theta.size)])


def _slope(logs: Array) -> Array:
    """Return the derivatives (D,) of u from its values (1 + D,) at a point and at steps from it."""
    return (logs[1:] - logs[0]) / _STEP


def best_reading(record: Record) -> tuple[float, float]:
    """Return depth (mm) and time (s) of the block mean whose force is largest over its noise."""
    blocks, motion = jax.tree.map(np.asarray, (record.blocks, record.motion))
    force = np.where(blocks.real, np.abs(blocks.force), 0.0)
    test, block = np.unravel_index(
        np.argmax(force * np.sqrt(blocks.count) / (blocks.weight * blocks.scale)), force.shape
    )
    node = int(np.asarray(record.nodes)[test, block, 1])
    displacement, time = motion.displacement[test], motion.time[test]
    first = int(np.argmax(np.abs(displacement) >= 0.5 * abs(displacement[node])))
    return float(displacement[node]), float(time[node] - time[min(first, node)])
