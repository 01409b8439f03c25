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
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array

_SWEEPS = 3  # of coordinate descent, which ends in two


@dataclass(frozen=True)
class ScatterPrior:
    """The prior of the sizes of the scatter between tests, relative sds."""

    none: Annotated[float, "prior probability of no scatter of stiffness and strengths"] = 0.5
    # with ``sizes`` values, evenly spaced in the logarithm
    smallest: Annotated[float, "smallest relative sd of stiffness and strengths"] = 0.01
    largest: Annotated[float, "largest relative sd of stiffness and strengths"] = 0.5
    sizes: Annotated[int, "number of relative sds of stiffness and strengths that are tried"] = 7
    # specimens and rigs mostly repeat to a few per cent
    typical: Annotated[
        float, "relative sd of stiffness and strengths beyond which the prior falls"
    ] = 0.05

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
    """Return the likeliest scatter, and the loss by it over that without scatter.

    curvature (K, K), slope (K,): A and b of the rows of V; groups (K,): the scaled part of each.
    """
    grid, log_prior = prior.grid
    costs, squares = log_prior[0] - log_prior, grid[:, None] ** 2
    count = int(groups.max(initial=-1)) + 1
    own = np.split(np.argsort(groups, kind="stable"), np.cumsum(np.bincount(groups))[:-1])

    def losses(a: Array, b: Array) -> Array:
        """Return the loss (S,) at each size of a group's scatter, given its A and b."""
        values, vectors = np.linalg.eigh(a)
        grown = 1.0 + squares * np.maximum(values, 0.0)
        gains = squares / grown * (vectors.T @ b) ** 2
        return np.asarray(costs + 0.5 * (np.log(grown) - gains).sum(axis=1))

    chosen = np.zeros(count, dtype=np.intp)
    alone = [losses(curvature[np.ix_(rows, rows)], slope[rows]) for rows in own]
    if all(one.argmin() == 0 for one in alone):
        return 0.0, Scatter(tuple(grid[chosen].tolist()))
    order = sorted(range(count), key=lambda k: alone[k].min())
    chosen[order[0]] = alone[order[0]].argmin()
    for _ in range(_SWEEPS):
        before = chosen.copy()
        for k in [*order[1:], order[0]]:
            others = np.flatnonzero((groups != k) & (chosen[groups] > 0))
            a, b, _ = _given(curvature, slope, own[k], others, grid[chosen[groups[others]]])
            chosen[k] = losses(a, b).argmin()
        if np.array_equal(before, chosen):
            break
    cost, every = float(costs[chosen].sum()), np.flatnonzero(chosen[groups])
    loss = _given(curvature, slope, every[:0], every, grid[chosen[groups[every]]])[2]
    return cost + loss, Scatter(tuple(grid[chosen].tolist()), cost)


def _given(
    curvature: Array, slope: Array, own: NDArray[np.intp], others: NDArray[np.intp], sizes: Array
) -> tuple[Array, Array, float]:
    """Return A and b of some rows given the scatter of others, and the loss by that of the others.

    own, others (R,): indices of the rows; sizes (R,): relative sds of the scales of the others.
    """
    a, b = curvature[np.ix_(own, own)], slope[own]
    if not len(sizes):
        return a, b, 0.0
    scaled = sizes[:, None] * curvature[np.ix_(others, others)] * sizes + np.eye(sizes.size)
    mixed = np.column_stack(
        [sizes[:, None] * curvature[np.ix_(others, own)], sizes * slope[others]]
    )
    factor = np.linalg.cholesky(scaled)
    halves = np.linalg.solve(factor, mixed)
    loss = float(np.log(np.diag(factor)).sum() - 0.5 * halves[:, -1] @ halves[:, -1])
    return a - halves[:, :-1].T @ halves[:, :-1], b - halves[:, :-1].T @ halves[:, -1], loss
