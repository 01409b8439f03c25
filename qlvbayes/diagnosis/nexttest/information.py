r"""The expected information of tests in bits, for linear forces and normal noise.

It depends on the whitened forces f_h of every explanation h and their slopes A_h along its free
parameters z ~ N(0, 1) only by their products (`Products`), which add up over tests. With
M = 1 + A^T A, the information about directions of z with orthonormal rows Q is

.. math:: I(Qz; y) = -\tfrac12 \log_2 \det(Q M^{-1} Q^T)

(half log det M for all of z; Lindley 1956, doi:10.1214/aoms/1177728069). Explanation h predicts
N(f_h, 1 + A_h A_h^T). The explanations of one cause g form a group with weights w. The information
about which of the groups, of probabilities p_g, is right has bounds in the distances D between them
(Kolchinsky & Tracey 2017, doi:10.3390/e19070361),

.. math:: I(g; y) \gtreqless -\sum_a p_a \log_2 \sum_b p_b e^{-D_{ab}}

from below with the Bhattacharyya distance, from above with the Kullback-Leibler divergence. Those
of groups are bounded by those of their members, as the root is subadditive and the divergence
convex:

.. math:: e^{-D_{ab}} \le \sum_{i \in a, j \in b} \sqrt{w_i w_j} e^{-D_{ij}}, \quad
          D_{ab} \le \sum_{i \in a, j \in b} w_i w_j D_{ij}
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Design, Rig
from qlvbayes.diagnosis.nexttest.records import ReadingErrors, record_of, whitening
from qlvbayes.io.arrays import Array
from qlvbayes.io.runtime import in_threads
from qlvbayes.motion.record import Record

_LN2 = float(np.log(2.0))


@dataclass(frozen=True, eq=False)
class Products:
    """The products of the whitened f_h and A_h in each of T tests, or series of tests."""

    # products (T, V, V); V counts f_h and the F slopes of one explanation after another
    values: Array
    sizes: tuple[int, ...]  # number F of free parameters of each explanation

    def __add__(self, other: Products) -> Products:
        """Return the products after both tests."""
        return Products(self.values + other.values, self.sizes)

    def __getitem__(self, rows: NDArray[np.intp]) -> Products:
        """Return the products of some of the tests."""
        return Products(self.values[rows], self.sizes)

    @classmethod
    def none(cls, sizes: Sequence[int]) -> Products:
        """Return the products (1, V, V) of no test: zero."""
        count = sum(1 + size for size in sizes)
        return cls(np.zeros((1, count, count)), tuple(sizes))

    @cached_property
    def _slices(self) -> list[slice]:
        """Return where each explanation's f_h and slopes are."""
        ends = accumulate((1 + size for size in self.sizes), initial=0)
        return [slice(a, b) for a, b in pairwise(ends)]

    def _block(self, i: int, j: int) -> Array:
        """Return A_i^T A_j (T, F_i, F_j)."""
        one, two = self._slices[i], self._slices[j]
        return self.values[:, one.start + 1 : one.stop, two.start + 1 : two.stop]

    def _toward(self, i: int, j: int, k: int) -> Array:
        """Return A_k^T (f_i - f_j) (T, F_k)."""
        own, one, two = (self._slices[n] for n in (k, i, j))
        rows = self.values[:, own.start + 1 : own.stop]
        return rows[..., one.start] - rows[..., two.start]

    def _apart(self, i: int, j: int) -> Array:
        """Return |f_i - f_j|^2 (T,)."""
        a, b = self._slices[i].start, self._slices[j].start
        v = self.values
        return np.maximum(v[:, a, a] - 2.0 * v[:, a, b] + v[:, b, b], 0.0)

    @cached_property
    def precisions(self) -> list[Array]:
        """M (T, F, F) of each explanation."""
        return [np.eye(size) + self._block(k, k) for k, size in enumerate(self.sizes)]

    @cached_property
    def _volumes(self) -> list[Array]:
        """Log det M (T,)."""
        return [np.linalg.slogdet(M)[1] for M in self.precisions]

    def bits_for(self, k: int, directions: Array) -> Array:
        """Return the bits (T,) about directions, rows (r, F), of explanation k's parameters."""
        if not len(directions):
            return np.zeros(len(self.values))
        left = directions @ np.linalg.solve(self.precisions[k], directions.T)
        return -0.5 * np.linalg.slogdet(left)[1] / _LN2

    def sds(self, k: int, gradient: Array) -> Array:
        """Return sds (T, P) of quantities after the tests."""
        spread = np.linalg.solve(self.precisions[k], gradient.T)
        return np.sqrt(np.maximum(np.einsum("pf,tfp->tp", gradient, spread), 0.0))

    def evidence(self, i: int, j: int) -> Array:
        """Return the expected 2 ln(Bayes factor) (T,) of i, if it is right, against j, at least."""
        taken = self._toward(i, j, j)
        solved = np.linalg.solve(self.precisions[j], taken[..., None])[..., 0]
        return np.maximum(self._apart(i, j) - np.einsum("tf,tf->t", taken, solved), 0.0)

    def bhattacharyya(self, i: int, j: int) -> Array:
        """Return the Bhattacharyya distance (T,) of the predictions of two explanations."""
        half = np.sqrt(0.5)
        ii, jj, ij = self._block(i, i), self._block(j, j), self._block(i, j)
        upper = np.concatenate([ii, ij], axis=2)
        lower = np.concatenate([np.swapaxes(ij, 1, 2), jj], axis=2)
        both = np.eye(ii.shape[1] + jj.shape[1]) + 0.5 * np.concatenate([upper, lower], axis=1)
        taken = half * np.concatenate([self._toward(i, j, i), self._toward(i, j, j)], axis=1)
        solved = np.linalg.solve(both, taken[..., None])[..., 0]
        apart = np.maximum(self._apart(i, j) - np.einsum("tf,tf->t", taken, solved), 0.0)
        volume = np.linalg.slogdet(both)[1] - 0.5 * (self._volumes[i] + self._volumes[j])
        return 0.125 * apart + 0.5 * np.maximum(volume, 0.0)

    def kullback(self, i: int, j: int) -> Array:
        """Return the Kullback-Leibler divergence (T,) of j's prediction from i's."""
        jj, ij = self._block(j, j), self._block(i, j)
        solved = np.linalg.solve(self.precisions[j], jj + np.swapaxes(ij, 1, 2) @ ij)
        trace = np.einsum("tff->t", self._block(i, i)) - np.einsum("tff->t", solved)
        volume = self._volumes[j] - self._volumes[i]
        return 0.5 * np.maximum(trace + self.evidence(i, j) + volume, 0.0)

    def bits_for_cause(
        self, probabilities: Array, groups: Sequence[Sequence[int]] | None = None
    ) -> tuple[Array, Array]:
        """Return bounds from below and above of the bits (T,) about which group is right."""
        groups = groups or [[k] for k in range(len(probabilities))]
        shares = np.array([probabilities[list(group)].sum() for group in groups])
        weights = [probabilities[list(g)] / p for g, p in zip(groups, shares, strict=True)]
        entropy = -float(shares @ np.log2(np.maximum(shares, 1e-300)))
        bounds = []
        for nearness in (self._overlap, self._divergence_factor):
            total = np.zeros(len(self.values))
            for a, p in enumerate(shares):
                near = sum(
                    q * (nearness(groups[a], weights[a], groups[b], weights[b]) if a != b else 1.0)
                    for b, q in enumerate(shares)
                )
                total -= p * np.log2(near)
            bounds.append(np.clip(total, 0.0, max(entropy, 0.0)))
        return bounds[0], bounds[1]

    def _overlap(self, a: Sequence[int], v: Array, b: Sequence[int], w: Array) -> Array:
        """Return a bound (T,) from above of the Bhattacharyya coefficient of two groups."""
        each = [np.sqrt(q) * np.exp(-self.bhattacharyya(i, j)) for i, j, q in _pairs(a, v, b, w)]
        return np.minimum(sum(each), 1.0)

    def _divergence_factor(self, a: Sequence[int], v: Array, b: Sequence[int], w: Array) -> Array:
        """Return a bound (T,) from below of e^-D of two groups, D their divergence."""
        return np.asarray(np.exp(-sum(q * self.kullback(i, j) for i, j, q in _pairs(a, v, b, w))))


def _pairs(
    a: Sequence[int], v: Array, b: Sequence[int], w: Array
) -> Iterator[tuple[int, int, float]]:
    """Yield all pairs of members of two groups with the product of their weights v and w."""
    for i, p in zip(a, v, strict=True):
        for j, q in zip(b, w, strict=True):
            yield i, j, p * q


def evidence(products: Products, groups: Sequence[Sequence[int]] | None = None) -> Array:
    """Return the expected 2 ln(Bayes factor) (T,) between the two nearest explanations."""
    groups = groups or [[k] for k in range(len(products.sizes))]
    pairs = [(i, j) for a in groups for b in groups if a is not b for i in a for j in b]
    if not pairs:
        return np.zeros(len(products.values))
    return np.asarray(np.min([products.evidence(i, j) for i, j in pairs], axis=0))


TOGETHER = 64
"""Designs that are run at once, so that one compiled shape serves any number of them."""


def screen(
    belief: Belief, designs: Sequence[Design], rig: Rig, errors: ReadingErrors, clock: float
) -> tuple[Products, NDArray[np.bool_]]:
    """Return the products of T designs, and a mask (T,) of those that give finite forces."""
    blocks = []
    for first in range(0, len(designs), TOGETHER):
        some = list(designs[first : first + TOGETHER])
        full = some + some[:1] * (TOGETHER - len(some))
        record = record_of(full, rig, clock)
        blocks.append(_products(belief, some, record, rig, errors))
    sizes = tuple(one.size for one in belief.explanations)
    values = np.concatenate(blocks)
    sound = np.asarray(np.isfinite(values).all(axis=(1, 2)))
    return Products(np.where(sound[:, None, None], values, 0.0), sizes), sound


def _products(
    belief: Belief, designs: Sequence[Design], record: Record, rig: Rig, errors: ReadingErrors
) -> Array:
    """Return the products (T, V, V) of T designs with their record."""
    rows = []
    for one in belief.explanations:
        force, slopes = one.slopes(np.zeros((1, one.size)), record)
        rows.append(np.concatenate([force, slopes[0]]))
    vectors = np.concatenate(rows)

    def product(k: int) -> Array:
        own = vectors[:, k]
        if not np.isfinite(own).all():
            return np.full((len(own), len(own)), np.nan)
        white = whitening(designs[k], k, record, rig, errors, own[0])(own)
        return np.asarray(white @ white.T)

    return np.stack(in_threads(product, range(len(designs))))
