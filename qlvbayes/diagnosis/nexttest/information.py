r"""What tests would tell, in bits, where forces are linear in what is not known and noise normal.

With the whitened forces f_h of every explanation h and their slopes A_h along its numbers
z ~ N(0, 1), all is said by products (`Products`), which add up over tests. With M = 1 + A^T A:

.. math:: I(Qz; y) = -\tfrac12 \log_2 \det(Q M^{-1} Q^T)

for some of the numbers, orthonormal rows Q (all: half log det M; Lindley 1956,
doi:10.1214/aoms/1177728069). Which explanation is right is told by predictions
N(f_h, 1 + A_h A_h^T). Those of one cause g are a group, of which the members' weights are w; what
a mixture of probabilities p_g tells of its groups has bounds in their distances D (Kolchinsky &
Tracey 2017, doi:10.3390/e19070361),

.. math:: I(g; y) \gtreqless -\sum_a p_a \log_2 \sum_b p_b e^{-D_{ab}}

from below with Bhattacharyya's distance, from above with Kullback and Leibler's. Of groups both are
themselves bounded by those of their members, as the root is subadditive and the divergence convex:

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

Array = NDArray[np.float64]

_LN2 = float(np.log(2.0))


@dataclass(frozen=True, eq=False)
class Products:
    """Products (T, V, V) of the whitened f_h and A_h of each of T tests, or series of tests.

    sizes: F of each explanation; V counts f_h and the F slopes of one after another.
    """

    values: Array
    sizes: tuple[int, ...]

    def __add__(self, other: Products) -> Products:
        """After both."""
        return Products(self.values + other.values, self.sizes)

    def __getitem__(self, rows: NDArray[np.intp]) -> Products:
        """Of some of the tests."""
        return Products(self.values[rows], self.sizes)

    @classmethod
    def none(cls, sizes: Sequence[int]) -> Products:
        """Of no test."""
        count = sum(1 + size for size in sizes)
        return cls(np.zeros((1, count, count)), tuple(sizes))

    @cached_property
    def _slices(self) -> list[slice]:
        ends = accumulate((1 + size for size in self.sizes), initial=0)
        return [slice(a, b) for a, b in pairwise(ends)]

    def _block(self, i: int, j: int) -> Array:
        """A_i^T A_j (T, F_i, F_j)."""
        one, two = self._slices[i], self._slices[j]
        return self.values[:, one.start + 1 : one.stop, two.start + 1 : two.stop]

    def _toward(self, i: int, j: int, k: int) -> Array:
        """A_k^T (f_i - f_j) (T, F_k)."""
        own, one, two = (self._slices[n] for n in (k, i, j))
        rows = self.values[:, own.start + 1 : own.stop]
        return rows[..., one.start] - rows[..., two.start]

    def _apart(self, i: int, j: int) -> Array:
        """|f_i - f_j|^2 (T,)."""
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

    def bits_for(self, k: int, asked: Array) -> Array:
        """Bits (T,) for what rows (r, F) say of explanation k's numbers."""
        if not len(asked):
            return np.zeros(len(self.values))
        left = asked @ np.linalg.solve(self.precisions[k], asked.T)
        return -0.5 * np.linalg.slogdet(left)[1] / _LN2

    def sds(self, k: int, gradient: Array) -> Array:
        """Sds (T, P) after the tests of what has slopes (P, F) along explanation k's numbers."""
        spread = np.linalg.solve(self.precisions[k], gradient.T)
        return np.sqrt(np.maximum(np.einsum("pf,tfp->tp", gradient, spread), 0.0))

    def evidence(self, i: int, j: int) -> Array:
        """Expected 2 ln of the Bayes factor (T,) of i, if it is right, against j, at the least.

        d^T (1 + A_j A_j^T)^-1 d, d = f_i - f_j: what j cannot follow of the difference.
        """
        taken = self._toward(i, j, j)
        solved = np.linalg.solve(self.precisions[j], taken[..., None])[..., 0]
        return np.maximum(self._apart(i, j) - np.einsum("tf,tf->t", taken, solved), 0.0)

    def bhattacharyya(self, i: int, j: int) -> Array:
        """Distance (T,) of the predictions of two explanations."""
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
        """Divergence (T,) of j's prediction from i's."""
        jj, ij = self._block(j, j), self._block(i, j)
        solved = np.linalg.solve(self.precisions[j], jj + np.swapaxes(ij, 1, 2) @ ij)
        trace = np.einsum("tff->t", self._block(i, i)) - np.einsum("tff->t", solved)
        volume = self._volumes[j] - self._volumes[i]
        return 0.5 * np.maximum(trace + self.evidence(i, j) + volume, 0.0)

    def bits_for_cause(
        self, probabilities: Array, groups: Sequence[Sequence[int]] | None = None
    ) -> tuple[Array, Array]:
        """Bits (T,) for which group of explanations is right: bounds from below and from above.

        groups: places of the explanations of each; by default each is one of its own.
        """
        groups = groups or [[k] for k in range(len(probabilities))]
        shares = np.array([probabilities[list(group)].sum() for group in groups])
        weights = [probabilities[list(g)] / p for g, p in zip(groups, shares, strict=True)]
        entropy = -float(shares @ np.log2(np.maximum(shares, 1e-300)))
        found = []
        for nearness in (self._overlap, self._divergence_factor):
            total = np.zeros(len(self.values))
            for a, p in enumerate(shares):
                near = sum(
                    q * (nearness(groups[a], weights[a], groups[b], weights[b]) if a != b else 1.0)
                    for b, q in enumerate(shares)
                )
                total -= p * np.log2(near)
            found.append(np.clip(total, 0.0, max(entropy, 0.0)))
        return found[0], found[1]

    def _overlap(self, a: Sequence[int], v: Array, b: Sequence[int], w: Array) -> Array:
        """At most 1: bound (T,) from above of the Bhattacharyya coefficient of two groups."""
        each = [np.sqrt(q) * np.exp(-self.bhattacharyya(i, j)) for i, j, q in _pairs(a, v, b, w)]
        return np.minimum(sum(each), 1.0)

    def _divergence_factor(self, a: Sequence[int], v: Array, b: Sequence[int], w: Array) -> Array:
        """Bound (T,) from below of e^-D of two groups, D their divergence."""
        return np.asarray(np.exp(-sum(q * self.kullback(i, j) for i, j, q in _pairs(a, v, b, w))))


def _pairs(
    a: Sequence[int], v: Array, b: Sequence[int], w: Array
) -> Iterator[tuple[int, int, float]]:
    """Members of two groups, and the product of their weights v and w."""
    for i, p in zip(a, v, strict=True):
        for j, q in zip(b, w, strict=True):
            yield i, j, p * q


def evidence(products: Products, groups: Sequence[Sequence[int]] | None = None) -> Array:
    """Expected 2 ln Bayes factor (T,) between the two nearest explanations; 0 of one alone.

    groups: as of `Products.bits_for_cause`; only explanations of two groups are compared.
    """
    groups = groups or [[k] for k in range(len(products.sizes))]
    pairs = [(i, j) for a in groups for b in groups if a is not b for i in a for j in b]
    if not pairs:
        return np.zeros(len(products.values))
    return np.asarray(np.min([products.evidence(i, j) for i, j in pairs], axis=0))
