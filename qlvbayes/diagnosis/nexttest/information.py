r"""The expected information of tests in bits, for linear forces and normal noise.

It depends on the whitened forces f_h of every explanation h and their slopes A_h along its
coordinates z ~ N(0, 1) only by their products (`Products`), which add up over tests. With
M = 1 + A^T A, the information about directions of z with orthonormal rows Q is

.. math:: I(Qz; y) = -\tfrac12 \log_2 \det(Q M^{-1} Q^T)

(half log det M for all of z; Lindley 1956, doi:10.1214/aoms/1177728069). Explanation h predicts
N(f_h, 1 + A_h A_h^T). If i is right, the expected logarithm of its Bayes factor against j is the
Kullback-Leibler divergence of these predictions,

.. math:: D_{ij} = \tfrac12 \left[\text{tr}\, \Sigma_j^{-1} (\Sigma_i - \Sigma_j)
          + (f_i - f_j)^T \Sigma_j^{-1} (f_i - f_j) + \ln |\Sigma_j| - \ln |\Sigma_i|\right],
          \quad \Sigma_h = 1 + A_h A_h^T,

whose determinants say how much less j has committed itself to. The explanations of one cause have
weights w. The information about which cause g, of probabilities p_g, is right has bounds in the
distances D between causes (Kolchinsky & Tracey 2017, doi:10.3390/e19070361),

.. math:: I(g; y) \gtreqless -\sum_a p_a \log_2 \sum_b p_b e^{-D_{ab}}

from below with the Bhattacharyya distance, from above with the Kullback-Leibler divergence. Of
causes, :math:`e^{-D_{ab}}` is at most :math:`\sum_{i \in a, j \in b} \sqrt{w_i w_j} e^{-D_{ij}}`
in the first, and :math:`D_{ab}` at most :math:`\sum w_i w_j D_{ij}` in the second, as the root is
subadditive and the divergence convex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import jax
import numpy as np

from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.readings import Readings
from qlvbayes.io.arrays import Array
from qlvbayes.io.runtime import in_threads

_LN2 = float(np.log(2.0))
_TOGETHER = 64  # designs that are run at once: their arrays take some ten megabytes


@dataclass(frozen=True, eq=False)
class Products:
    """The products of the whitened f_h and A_h in each of T tests, or series of tests."""

    belief: Belief
    # products (T, V, V); V counts f_h and the F slopes of one explanation after another
    values: Array

    @cached_property
    def _starts(self) -> list[int]:
        """Where each explanation's f_h is, before its slopes."""
        return np.cumsum([0, *(1 + one.size for one in self.belief.explanations)]).tolist()

    def _slopes(self, k: int) -> slice:
        return slice(self._starts[k] + 1, self._starts[k + 1])

    @cached_property
    def precisions(self) -> list[Array]:
        """M (T, F, F) of each explanation."""
        count = len(self.belief.explanations)
        blocks = [self.values[:, self._slopes(k), self._slopes(k)] for k in range(count)]
        return [np.eye(block.shape[1]) + block for block in blocks]

    @cached_property
    def _volumes(self) -> list[Array]:
        """Log det M (T,)."""
        return [np.linalg.slogdet(M)[1] for M in self.precisions]

    def bits_for(self, k: int, directions: Array) -> Array:
        """Return the bits (T,) about directions, rows (r, F), of explanation k's parameters."""
        left = directions @ np.linalg.solve(self.precisions[k], directions.T)
        return -0.5 * np.linalg.slogdet(left)[1] / _LN2

    def bits_for_constants(self, names: Sequence[str]) -> Array:
        """Return the bits (T,) about constants, averaged over the explanations."""
        some = enumerate(self.belief.explanations)
        bits = [one.probability * self.bits_for(k, one.directions(names)) for k, one in some]
        return np.sum(bits, axis=0)

    def sds(self, k: int, gradient: Array) -> Array:
        """Return sds (T, P) after the tests of quantities with slopes (P, F) along z."""
        spread = np.linalg.solve(self.precisions[k], gradient.T)
        return np.sqrt(np.maximum(np.einsum("pf,tfp->tp", gradient, spread), 0.0))

    def _between(self, i: int, j: int) -> Array:
        """Return the products (T, W, W) of f_i - f_j, the slopes of j, and those of i."""
        unit = np.eye(self.values.shape[1])
        apart = unit[[self._starts[i]]] - unit[[self._starts[j]]]
        rows = np.concatenate([apart, unit[self._slopes(j)], unit[self._slopes(i)]])
        return np.asarray(rows @ self.values @ rows.T)

    def bhattacharyya(self, i: int, j: int) -> Array:
        """Return the Bhattacharyya distance (T,) of the predictions of two explanations."""
        apart, volume = _distance(self._between(i, j), 0.5)
        more = volume - 0.5 * (self._volumes[i] + self._volumes[j])
        return 0.125 * apart + 0.5 * np.maximum(more, 0.0)

    def kullback(self, i: int, j: int) -> Array:
        """Return the Kullback-Leibler divergence D_ij (T,)."""
        every, own = self._between(i, j), 1 + self.belief.explanations[j].size
        apart, volume = _distance(every[:, :own, :own], 1.0)
        jj, ij, ii = every[:, 1:own, 1:own], every[:, own:, 1:own], every[:, own:, own:]
        solved = np.linalg.solve(self.precisions[j], jj + np.swapaxes(ij, 1, 2) @ ij)
        trace = np.einsum("tff->t", ii) - np.einsum("tff->t", solved)
        return 0.5 * np.maximum(trace + apart + volume - self._volumes[i], 0.0)

    def bits_for_cause(self) -> tuple[Array, Array]:
        """Return bounds (T,) from below and above of the bits about which cause is right."""
        count = range(len(self.belief.explanations))
        zero, weights = np.zeros(len(self.values)), self.belief.shares
        near = [[zero if i == j else self.bhattacharyya(i, j) for j in count] for i in count]
        far = [[zero if i == j else self.kullback(i, j) for j in count] for i in count]
        roots, probabilities = np.sqrt(weights), np.array(list(self.belief.causes.values()))
        factors = (
            np.minimum(np.einsum("ai,ijt,bj->tab", roots, np.exp(-np.array(near)), roots), 1.0),
            np.exp(-np.einsum("ai,ijt,bj->tab", weights, np.array(far), weights)),
        )
        bounds = []
        for factor in factors:
            factor[:, range(len(weights)), range(len(weights))] = 1.0
            bits = -np.log2(factor @ probabilities) @ probabilities
            bounds.append(np.clip(bits, 0.0, max(self.belief.entropy, 0.0)))
        return bounds[0], bounds[1]

    def evidence(self) -> Array:
        """Return the expected 2 ln(Bayes factor) (T,) of the nearest explanations of two causes.

        It is that of the one which is right: of each pair the less telling of both cases.
        """
        causes = [one.cause for one in self.belief.explanations]
        pairs = [(i, j) for i, a in enumerate(causes) for j, b in enumerate(causes) if a != b]
        if not pairs:
            return np.zeros(len(self.values))
        return np.asarray(2.0 * np.min([self.kullback(i, j) for i, j in pairs], axis=0))


def _distance(products: Array, share: float) -> tuple[Array, Array]:
    """Return d^T (1 + share A A^T)^-1 d (T,) and log det(1 + share A^T A) (T,).

    products (T, 1 + F, 1 + F): of d and the columns of A.
    """
    towards = products[:, 1:, :1]
    inner = np.eye(towards.shape[1]) + share * products[:, 1:, 1:]
    taken = share * np.sum(towards * np.linalg.solve(inner, towards), axis=(1, 2))
    return np.maximum(products[:, 0, 0] - taken, 0.0), np.linalg.slogdet(inner)[1]


def between(low: Array, high: Array) -> Array:
    """Return the expected bits about the cause from their bounds (`Products.bits_for_cause`).

    For causes that differ little the bounds are half and twice the information.
    """
    return low + (high - low) / 3.0


def screen(belief: Belief, designs: Sequence[Design], readings: Readings) -> Products:
    """Return the products of T designs; NaN for those whose force is not finite."""
    parts = [designs[k : k + _TOGETHER] for k in range(0, len(designs), _TOGETHER)]
    return Products(belief, np.concatenate([_products(belief, some, readings) for some in parts]))


def _products(belief: Belief, designs: Sequence[Design], readings: Readings) -> Array:
    """Return the products (T, V, V) of T designs."""
    record = readings.record(designs)
    vectors = np.concatenate([one.force_and_slopes(record) for one in belief.explanations])

    def product(k: int) -> Array:
        own, blocks = vectors[:, k], jax.tree.map(lambda x: x[k], record.blocks)
        if not np.isfinite(own).all():
            return np.full((len(own), len(own)), np.nan)
        white = readings.whitened(designs[k], blocks, own[0], own)
        return np.asarray(white @ white.T)

    return np.stack(in_threads(product, range(len(designs))))
