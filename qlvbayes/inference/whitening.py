r"""Block means as independent numbers of unit variance, under the noise floor alone.

With the Cholesky factor of each test's covariance, Sigma = L L^T,

.. math:: \tilde x = L^{-1} x,

so that products of whitened vectors are the products :math:`x^T \Sigma^{-1} y` of a likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from qlvbayes.inference.floor_covariance import covariance
from qlvbayes.noisefloor import NoiseFloor
from qlvbayes.records.record import Blocks

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Whitener:
    """One factor a test; n blocks in all that are no padding.

    blocks: of each test, which of its B blocks are real; factors: lower Cholesky factors (N^2 under
    the root); tests: which test each of the n blocks is of.
    """

    blocks: tuple[NDArray[np.bool_], ...]
    factors: tuple[Array, ...]
    tests: NDArray[np.intp]

    @classmethod
    def of(cls, floor: NoiseFloor, blocks: Blocks, peak: float) -> Whitener:
        """Of a floor; peak: largest force (N), a share of which every block mean has as noise."""
        arrays = jax.tree.map(np.asarray, blocks)
        factors = []
        for k, real in enumerate(arrays.real):
            of_test = jax.tree.map(lambda x, k=k, real=real: x[k][real], arrays)
            factors.append(cholesky(covariance(floor, of_test, peak), lower=True))
        sizes = [len(factor) for factor in factors]
        tests = np.repeat(np.arange(len(sizes)), sizes)
        return cls(tuple(arrays.real), tuple(factors), tests)

    def replaced(self, size: float) -> Whitener:
        """As if the noise of every block were independent, of one size (N)."""
        factors = tuple(size * np.eye(len(factor)) for factor in self.factors)
        return Whitener(self.blocks, factors, self.tests)

    def __call__(self, vectors: Array) -> Array:
        """(M, T, B) to (M, n)."""
        parts = [
            solve_triangular(factor, vectors[:, k, real].T, lower=True, check_finite=False).T
            for k, (real, factor) in enumerate(zip(self.blocks, self.factors, strict=True))
        ]
        return np.concatenate(parts, axis=1)
