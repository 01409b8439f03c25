"""Propose points independently of the walkers, from a mixture of Student-t kernels.

The mixture is shaped like the posterior. It has one wide kernel about a normal approximation, or
many kernels on draws of the chain, each with the covariance of the draws around it (a kernel
estimate with local bandwidths, as in West 1993, doi:10.1111/j.2517-6161.1993.tb01911.x), which
follows skewed, curved and two-peaked posteriors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logsumexp

from qlvbayes.fitting.least_squares import NormalApproximation

TAIL = 5.0  # degrees of freedom of each kernel
KERNELS = 256
_NEIGHBOURS = 0.1  # share of the draws that shape a kernel


@dataclass(frozen=True)
class Proposal:
    """A mixture of equally weighted t kernels at ``centres`` (K, D) with ``roots`` (K, D, D)."""

    centres: np.ndarray
    roots: np.ndarray

    @cached_property
    def _inverses(self) -> np.ndarray:
        """Return the inverses (K, D, D) of the roots."""
        return np.linalg.inv(self.roots)

    @cached_property
    def _log_volumes(self) -> np.ndarray:
        """Return the log determinants (K,) of the roots."""
        return np.sum(np.log(np.diagonal(self.roots, axis1=1, axis2=2)), axis=1)

    def draw(self, count: int, random: np.random.RandomState) -> np.ndarray:
        """Return points (count, D)."""
        kernel = random.randint(len(self.centres), size=count)
        normal = random.standard_normal((count, self.centres.shape[1]))
        offset = np.einsum("nij,nj->ni", self.roots[kernel], normal)
        return self.centres[kernel] + offset * np.sqrt(
            TAIL / random.chisquare(TAIL, size=(count, 1))
        )

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


def from_normal(normal: NormalApproximation) -> Proposal:
    """Return one kernel: the normal approximation with the tails of a Student-t."""
    return Proposal(normal.mean[None], np.linalg.cholesky(normal.covariance)[None])


def from_draws(draws: np.ndarray) -> Proposal:
    """Return kernels on at most 256 of the draws (N, D), evenly selected."""
    size = draws.shape[1]
    covariance = np.cov(draws, rowvar=False).reshape(size, size)
    floor = 1e-6 * np.diag(np.diag(covariance) + 1e-300)
    white = draws @ np.linalg.inv(np.linalg.cholesky(covariance + floor)).T
    centres = np.linspace(0, len(draws) - 1, min(KERNELS, len(draws))).astype(int)
    count = min(max(int(_NEIGHBOURS * len(draws)), 10 * size), len(draws))
    _, neighbours = cKDTree(white).query(white[centres], k=count)
    local = np.array(
        [np.cov(draws[members], rowvar=False).reshape(size, size) for members in neighbours]
    )
    return Proposal(draws[centres], np.linalg.cholesky(local + floor))
