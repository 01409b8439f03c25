r"""Scatter between tests: the stiffness and the strengths of effects differ from test to test.

No specimen is the same in each of its tests. In test k the force of the base laws and of each
effect e is scaled at random,

.. math:: F_k = e^{a_k} \Big(F - \sum_e F_e\Big) + \sum_e e^{b_{ek}} F_e, \quad
          a_k \sim N(0, s_0^2), \quad b_{ek} \sim N(0, s_e^2),

which to the first order adds V^T S V to the covariance of the block means: V has a row for each
test and each scaled part of the force, zero in the other tests, and S holds the squared sizes
(random coefficients; Laird & Ware 1982, doi:10.2307/2529876). The force of an effect is its
amplitude times the derivative by it, and the base laws have the rest. With A = V C^-1 V^T and
b = V C^-1 r for the covariance C of all else, the sizes change minus the log likelihood by

.. math:: \tfrac12 \ln |1 + S A| - \tfrac12 b^T (S^{-1} + A)^{-1} b.

As a discrepancy, the scatter is separated from what the constants can follow (`separation`), so
that the constants are those of least squares, and their spread by it is added where they are told.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array

_SWEEPS = 3  # of coordinate descent, which ends in two


@dataclass(frozen=True)
class ScatterPrior:
    """The prior of the sizes of the scatter between tests, relative sds."""

    none: float = 0.5  # prior probability that there is none, 0.5 as it is undecided
    # smallest, largest: range of a size, with ``sizes`` values, evenly spaced in the logarithm
    smallest: float = 0.01
    largest: float = 0.5
    sizes: int = 7
    # size beyond which the prior falls, as specimens and rigs mostly repeat to a few per cent
    typical: float = 0.05

    @property
    def grid(self) -> tuple[Array, Array]:
        """Return the sizes (S,), zero first, and their log prior probabilities (S,)."""
        some = np.geomspace(self.smallest, self.largest, self.sizes)
        density = 1.0 / (1.0 + some / self.typical)
        shares = np.concatenate([[self.none], (1.0 - self.none) * density / density.sum()])
        return np.concatenate([[0.0], some]), np.log(shares)


UNDECIDED = ScatterPrior()


class Scatter(NamedTuple):
    """The relative sds (G,) of the scales of the base laws and of each effect, and their cost."""

    sizes: tuple[float, ...] = ()
    cost: float = 0.0  # log of the prior probability of no scatter over that of these sizes


NONE = Scatter()


def scaled_parts(predicted: Array, responses: Array, theta: Array, amplitudes: list[int]) -> Array:
    """Return the parts of the force whose scale differs between tests, (1 + E, T, B) in N."""
    effects = theta[amplitudes, None, None] * responses[amplitudes]
    return np.concatenate([(predicted - effects.sum(axis=0))[None], effects])


def by_test(parts: Array) -> Array:
    """Return rows (G T, T, B) of parts (G, T, B): each part in each test, zero in the others."""
    tests = parts.shape[1]
    apart: Array = parts[:, None] * np.eye(tests)[:, :, None]
    return apart.reshape(-1, *parts.shape[1:])


def likeliest(
    curvature: Array, slope: Array, groups: NDArray[np.intp], prior: ScatterPrior
) -> tuple[float, Scatter]:
    """Return the likeliest scatter, and the loss by it over that without scatter."""
    grid, log_prior = prior.grid
    count = int(groups.max(initial=-1)) + 1
    chosen = np.zeros(count, dtype=np.intp)

    def losses(some: NDArray[np.intp]) -> Array:
        """Return the loss (R,) of R choices of the sizes (R, G), as indices."""
        roots = grid[some][:, groups]
        scaled = curvature * roots[:, :, None] * roots[:, None, :] + np.eye(groups.size)
        factors = np.linalg.cholesky(scaled)
        halves = np.linalg.solve(factors, (roots * slope)[..., None])[..., 0]
        volumes = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        costs = (log_prior[0] - log_prior[some]).sum(axis=1)
        return np.asarray(costs + volumes - 0.5 * (halves**2).sum(axis=1))

    best = 0.0
    for _ in range(_SWEEPS):
        before = chosen.copy()
        for k in range(count):
            some = np.tile(chosen, (grid.size, 1))
            some[:, k] = np.arange(grid.size)
            found = losses(some)
            least = int(np.argmin(found))
            if found[least] < best:
                best, chosen = float(found[least]), some[least]
        if np.array_equal(before, chosen):
            break
    cost = float((log_prior[0] - log_prior[chosen]).sum())
    return best, Scatter(tuple(grid[chosen].tolist()), cost)
