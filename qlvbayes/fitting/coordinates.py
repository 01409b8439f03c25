r"""The coordinates in which a chain moves, with the best force in them, and proposals there.

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
from functools import cached_property
from typing import Self

import jax
import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logsumexp

from qlvbayes.fitting.least_squares import NormalApproximation
from qlvbayes.fitting.posterior import Posterior
from qlvbayes.inference.forward.fixedrates import relaxation_of
from qlvbayes.io.arrays import Array
from qlvbayes.motion.record import Record

_TRIALS = 64  # draws at which u is tried
_EXACT = 1e-9  # rounding of u
_STEP = 1e-5  # in theta's units of order one: of a shape that a Metropolis step corrects
TAIL = 5.0  # degrees of freedom of each kernel of a proposal
_KERNELS = 256
_NEIGHBOURS = 0.1  # share of the draws that shape a kernel


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
        some = start.draw(_TRIALS, np.random.default_rng(0))
        some = posterior.parameters.within(some)
        at_mean, slope = straight._expanded(start.mean)
        logs, units = straight._logs(some), np.eye(posterior.size)
        if not np.isfinite([at_mean, *slope, *logs]).all():  # as with the platen off the specimen
            return straight
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
        jacobian[self.index] = self._expanded(normal.mean)[1]
        covariance = jacobian @ normal.covariance @ jacobian.T
        return NormalApproximation(self.from_theta(normal.mean), covariance)

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

    def _expanded(self, theta: Array) -> tuple[float, Array]:
        """Return u at theta (D,), and its derivatives (D,) by finite steps."""
        steps = np.vstack([np.zeros(theta.size), np.eye(theta.size)])
        at, *moved = self._logs(theta + _STEP * steps)
        with np.errstate(invalid="ignore"):  # of no force: a slope that is not finite is not used
            return float(at), (np.array(moved) - at) / _STEP


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


@dataclass(frozen=True)
class KernelProposal:
    """A mixture of equally weighted t kernels at ``centres`` (K, D) with ``roots`` (K, D, D).

    It proposes points independently of the walkers, and is shaped like the posterior: one wide
    kernel about a normal approximation, or many kernels on draws of the chain, each with the
    covariance of the draws around it (a kernel estimate with local bandwidths, as in West 1993,
    doi:10.1111/j.2517-6161.1993.tb01911.x), which follows skewed, curved and two-peaked posteriors.
    """

    centres: np.ndarray
    roots: np.ndarray

    @cached_property
    def _inverses(self) -> np.ndarray:
        return np.linalg.inv(self.roots)

    @cached_property
    def _log_volumes(self) -> np.ndarray:
        return np.sum(np.log(np.diagonal(self.roots, axis1=1, axis2=2)), axis=1)

    def draw(self, count: int, random: np.random.RandomState) -> np.ndarray:
        """Return points (count, D)."""
        kernel = random.randint(len(self.centres), size=count)
        normal = random.standard_normal((count, self.centres.shape[1]))
        offset = np.einsum("nij,nj->ni", self.roots[kernel], normal)
        widened = np.sqrt(TAIL / random.chisquare(TAIL, size=(count, 1)))
        return self.centres[kernel] + offset * widened

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Return the log density (N,) at points (N, D), up to a constant."""
        offset = points[None] - self.centres[:, None]
        squared = np.sum((offset @ self._inverses.transpose(0, 2, 1)) ** 2, axis=2)
        heights = -0.5 * (TAIL + points.shape[1]) * np.log1p(squared / TAIL)
        return logsumexp(heights - self._log_volumes[:, None], axis=0)

    def move(
        self, coords: np.ndarray, random: np.random.RandomState
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return new points for walkers at ``coords``, and log q(old)/q(new), as emcee expects."""
        new = self.draw(len(coords), random)
        return new, self.log_density(coords) - self.log_density(new)


def from_normal(normal: NormalApproximation) -> KernelProposal:
    """Return one kernel: the normal approximation with the tails of a Student-t."""
    return KernelProposal(normal.mean[None], np.linalg.cholesky(normal.covariance)[None])


def from_draws(draws: np.ndarray) -> KernelProposal:
    """Return kernels on at most 256 of the draws (N, D), evenly selected."""
    size = draws.shape[1]
    covariance = np.cov(draws, rowvar=False).reshape(size, size)
    floor = 1e-6 * np.diag(np.diag(covariance) + 1e-300)
    white = draws @ np.linalg.inv(np.linalg.cholesky(covariance + floor)).T
    centres = np.linspace(0, len(draws) - 1, min(_KERNELS, len(draws))).astype(int)
    count = min(max(int(_NEIGHBOURS * len(draws)), 10 * size), len(draws))
    _, neighbours = cKDTree(white).query(white[centres], k=count)
    local = np.array(
        [np.cov(draws[members], rowvar=False).reshape(size, size) for members in neighbours]
    )
    return KernelProposal(draws[centres], np.linalg.cholesky(local + floor))
