r"""Block means as independent numbers of unit variance, under the noise floor alone.

The floor gives each test's block means a `covariance`. With its eigenvectors and eigenvalues,
Sigma = V diag(lambda) V^T,

.. math:: \tilde x = \lambda^{-1/2} V^T x,

so that products of whitened vectors are the products :math:`x^T \Sigma^{-1} y` of a likelihood, and
noise of variance a, independent from block to block, adds :math:`a / \lambda` to each variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.noisefloor.averages import rate, regression, variance
from qlvbayes.motion.record import Blocks

Array = NDArray[np.float64]

_LEAST = 1e-6  # sd of a block mean, over the largest force, that keeps covariances invertible
_SINGULAR = 1e-14  # of the largest eigenvalue: less is rounding


@dataclass(frozen=True, eq=False)
class Whitener:
    """Of the n blocks of T tests that are no padding and not left out.

    blocks: of each test, which of its B blocks those are; covariances: of their means (N^2);
    timing: what of their variances is for what is not known of moments (N^2).
    """

    blocks: tuple[NDArray[np.bool_], ...]
    covariances: tuple[Array, ...]
    timing: tuple[Array, ...]

    @classmethod
    def of(cls, floor: NoiseFloor, blocks: Blocks, peak: float) -> Whitener:
        """Of a floor; peak: largest force (N), a share of which every block mean has as noise."""
        arrays = jax.tree.map(np.asarray, blocks)
        found, timing = [], []
        for k, real in enumerate(arrays.real):
            of_test = jax.tree.map(lambda x, k=k, real=real: x[k][real], arrays)
            found.append(covariance(floor, of_test, peak))
            timing.append(of_test.timing**2)
        return cls(tuple(arrays.real), tuple(found), tuple(timing))

    def replaced(self, size: float) -> Whitener:
        """As if the noise of every block were independent, of one size (N)."""
        found = tuple(size**2 * np.eye(len(one)) for one in self.covariances)
        return Whitener(self.blocks, found, tuple(np.zeros(len(one)) for one in found))

    def without(self, left_out: NDArray[np.bool_]) -> Whitener:
        """Less some (n,) of the blocks."""
        masks, found, timing = [], [], []
        for k, (real, of_test) in enumerate(zip(self.blocks, self.covariances, strict=True)):
            kept = ~left_out[self.tests == k]
            mask = real.copy()
            mask[real] = kept
            masks.append(mask)
            found.append(of_test[np.ix_(kept, kept)])
            timing.append(self.timing[k][kept])
        return Whitener(tuple(masks), tuple(found), tuple(timing))

    @cached_property
    def tests(self) -> NDArray[np.intp]:
        """(n,) which test each block is of."""
        sizes = [len(one) for one in self.covariances]
        return np.repeat(np.arange(len(sizes)), sizes)

    @cached_property
    def _bases(self) -> list[tuple[Array, Array]]:
        """Of each test: 1/sqrt(lambda), and the rows of V^T over it."""
        found = []
        for one in self.covariances:
            values, vectors = np.linalg.eigh(one)
            roots = np.maximum(values, _SINGULAR * values.max(initial=0.0)) ** -0.5
            found.append((roots, roots[:, None] * vectors.T))
        return found

    @cached_property
    def precisions(self) -> Array:
        """(n,) 1/lambda (1/N^2)."""
        return np.concatenate([roots**2 for roots, _ in self._bases])

    @property
    def matrix(self) -> Array:
        """(n, n) what takes the block means of all tests, one after another, to whitened ones."""
        return np.asarray(block_diag(*(rows for _, rows in self._bases)))

    def plain(self, vectors: Array) -> Array:
        """(M, T, B) to (M, n): the block means that count, one test after another."""
        return np.concatenate([vectors[:, k, own] for k, own in enumerate(self.blocks)], axis=1)

    def of_plain(self, vectors: Array) -> Array:
        """(M, n) whitened."""
        ends = np.cumsum([len(one) for one in self.covariances])[:-1]
        parts = np.split(vectors, ends, axis=1)
        whitened = [part @ rows.T for part, (_, rows) in zip(parts, self._bases, strict=True)]
        return np.concatenate(whitened, axis=1)

    def __call__(self, vectors: Array) -> Array:
        """(M, T, B) to (M, n) whitened."""
        return self.of_plain(self.plain(vectors))


def covariance(floor: NoiseFloor, blocks: Blocks, peak: float) -> np.ndarray:
    """Covariance (N, N) of the noise of one test's block means (N^2); peak: largest force (N).

    A millionth of it every block mean has, whatever the floor. What the motion is not known by is
    one error a block, and alike over a movement; what moments are not known by is independent.
    """
    first, last, count, weight, scale, extra, timing = map(
        np.asarray,
        (
            *(blocks.first, blocks.last, blocks.count),
            *(blocks.weight, blocks.scale, blocks.extra, blocks.timing),
        ),
    )
    white = (floor.white * weight * scale) ** 2 / count + timing**2 + (_LEAST * peak) ** 2
    correlated = floor.ou**2 * np.outer(scale, scale)
    correlation = averaged_correlation(first, last, count, floor.tau, floor.smooth)
    moving = (extra > 0.0).astype(float)
    group = np.cumsum(np.abs(np.diff(moving, prepend=moving[:1])))
    alike = np.where(group[:, None] == group, 0.5, 0.0)
    motion = np.outer(extra, extra) * (alike + 0.5 * np.eye(extra.size))
    return np.diag(white) + correlated * correlation + motion


def averaged_correlation(
    first: np.ndarray, last: np.ndarray, count: np.ndarray, tau: float, smooth: bool = False
) -> np.ndarray:
    """Correlation (N, N) of means over ``count`` evenly spaced readings of a unit process."""
    z = rate(tau, smooth)
    mean = regression(last - first, count, z)
    gap = np.maximum(first[None, :] - last[:, None], 0.0)
    found = np.exp(-z * (gap + gap.T)) * np.outer(mean, mean)
    np.fill_diagonal(found, variance(last - first, count, z))
    return np.real(z * tau * found)
