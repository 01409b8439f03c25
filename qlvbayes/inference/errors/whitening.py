r"""Turn block means into independent numbers of unit variance under the noise floor.

The floor gives the block means of each test a `covariance`. The dwells leave its standard
deviations and its correlation time open to some degree, so that Sigma is the mean of the
covariances of floors that are likely given the dwells (`expected_covariance`): the second moment of
the noise as far as it is known. With its eigenvectors and eigenvalues, Sigma = V diag(lambda) V^T,

.. math:: \tilde x = \lambda^{-1/2} V^T x,

so that products of whitened vectors are the products :math:`x^T \Sigma^{-1} y` of a likelihood.
Additional noise of variance a, independent from block to block, adds :math:`a / \lambda` to each
variance.

An error common to tests, such as that of one stage's contact, with the change :math:`u` of the
block means for one standard error, adds :math:`u u^T`, which joins them. It is an unknown constant
with a normal prior, integrated out to first order. With whitened changes
:math:`\tilde U = L\, \text{diag}(s)\, R^T`,

.. math:: \tilde x' = \left(1 - R\, \text{diag}(1 - (1 + s^2)^{-1/2})\, R^T\right) \tilde x

is white. Additional independent noise is taken to be what it is without the shared errors, which in
their few directions R makes it larger than it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from qlvbayes.io.arrays import Array
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.noisefloor.pool import regression, variance
from qlvbayes.motion.record import Blocks

_LEAST = 1e-6  # smallest sd of a block mean over the largest force, for invertible covariances
_SINGULAR = 1e-14  # eigenvalues below this share of the largest are rounding


@dataclass(frozen=True, eq=False)
class Whitener:
    """The whitening of the n blocks of T tests that are neither padding nor left out."""

    blocks: tuple[NDArray[np.bool_], ...]  # for each test, a mask (B,) of those blocks
    covariances: tuple[Array, ...]  # of their means, for each test (N^2)
    # the part of their variances that uncertain moments contribute, for each test (N^2)
    timing: tuple[Array, ...]
    # (S, n): changes of the block means (N) for one standard error of each that tests share
    common: Array | None = None

    @classmethod
    def from_floor(cls, floor: NoiseFloor, blocks: Blocks, peak: float) -> Whitener:
        """Return the whitener of a noise floor; peak: largest force (N), see `covariance`."""
        arrays = jax.tree.map(np.asarray, blocks)
        covariances, timing = [], []
        for k, real in enumerate(arrays.real):
            of_test = jax.tree.map(lambda x, k=k, real=real: x[k][real], arrays)
            covariances.append(expected_covariance(floor, of_test, peak))
            timing.append(of_test.timing**2)
        return cls(tuple(arrays.real), tuple(covariances), tuple(timing))

    @property
    def sds(self) -> Array:
        """Return the sd (n,) of the noise of each block mean (N)."""
        variances = np.concatenate([np.diag(one) for one in self.covariances])
        if self.common is not None:
            variances += np.sum(self.common**2, axis=0)
        return np.sqrt(variances)

    @property
    def covariance(self) -> Array:
        """Return the covariance (n, n) of the block means of all tests (N^2)."""
        own = np.asarray(block_diag(*self.covariances))
        if self.common is not None:
            own += self.common.T @ self.common
        return own

    def with_common(self, changes: Array) -> Whitener:
        """Return the whitener with errors that tests share, of changes (S, T, B) in N."""
        if not len(changes):
            return self
        joint = replace(self, common=self.flattened(changes))
        joint.__dict__["_bases"] = self._bases
        return joint

    def with_independent_noise(self, sds: Array | float) -> Whitener:
        """Return the whitener for independent noise of sds (n,), or one sd, of block means (N)."""
        sds = np.broadcast_to(sds, self.tests.shape)
        covariances = tuple(
            np.diag(sds[self.tests == k] ** 2) for k in range(len(self.covariances))
        )
        return Whitener(self.blocks, covariances, tuple(np.zeros(len(one)) for one in covariances))

    def without(self, left_out: NDArray[np.bool_]) -> Whitener:
        """Return the whitener without some of the n blocks, which left_out (n,) marks."""
        masks, covariances, timing, bases = [], [], [], []
        for k, (real, of_test) in enumerate(zip(self.blocks, self.covariances, strict=True)):
            kept = ~left_out[self.tests == k]
            mask = real.copy()
            mask[real] = kept
            masks.append(mask)
            # tests that stay whole share their matrices, of which each may take a megabyte
            covariances.append(of_test if kept.all() else of_test[np.ix_(kept, kept)])
            timing.append(self.timing[k][kept])
            bases.append(self._bases[k] if kept.all() else _basis(covariances[-1]))
        common = None if self.common is None else self.common[:, ~left_out]
        other = Whitener(tuple(masks), tuple(covariances), tuple(timing), common)
        other.__dict__["_bases"] = bases
        return other

    @cached_property
    def tests(self) -> NDArray[np.intp]:
        """Return the index (n,) of the test that each block belongs to."""
        sizes = [len(one) for one in self.covariances]
        return np.repeat(np.arange(len(sizes)), sizes)

    @cached_property
    def _bases(self) -> list[tuple[Array, Array]]:
        """Return the basis of each test, see `_basis`."""
        return [_basis(one) for one in self.covariances]

    @cached_property
    def precisions(self) -> Array:
        """Return the precisions 1/lambda (n,) in 1/N^2."""
        return np.concatenate([roots**2 for roots, _ in self._bases])

    @cached_property
    def _turn(self) -> tuple[Array, Array]:
        """Return directions (n, S) of the shared errors, and the shares (S,) to take off."""
        assert self.common is not None
        _, sizes, axes = np.linalg.svd(self._whiten_alone(self.common), full_matrices=False)
        return axes.T, 1.0 - (1.0 + sizes**2) ** -0.5

    @property
    def matrix(self) -> Array:
        """Return the matrix (n, n) that whitens the block means of all tests, joined."""
        own = block_diag(*(np.diag(x) if x.ndim == 1 else x for _, x in self._bases))
        if self.common is not None:
            axes, less = self._turn
            own = own - (axes * less) @ (axes.T @ own)
        return np.asarray(own)

    def flattened(self, vectors: Array) -> Array:
        """Return (M, T, B) as (M, n): the block means that count, one test after another."""
        return np.concatenate([vectors[:, k, own] for k, own in enumerate(self.blocks)], axis=1)

    def whiten(self, vectors: Array) -> Array:
        """Return (M, n) whitened."""
        own = self._whiten_alone(vectors)
        if self.common is not None:
            axes, less = self._turn
            own = own - ((own @ axes) * less) @ axes.T
        return own

    def _whiten_alone(self, vectors: Array) -> Array:
        ends = np.cumsum([len(one) for one in self.covariances])[:-1]
        parts = np.split(vectors, ends, axis=1)
        whitened = [self.whiten_test(k, part) for k, part in enumerate(parts)]
        return np.concatenate(whitened, axis=1)

    def whiten_test(self, test: int, vectors: Array) -> Array:
        """Return the block means (M, n_t) of one test whitened."""
        rows = self._bases[test][1]
        return vectors * rows if rows.ndim == 1 else vectors @ rows.T

    def __call__(self, vectors: Array) -> Array:
        """Return (M, T, B) whitened, as (M, n)."""
        return self.whiten(self.flattened(vectors))


def shared_stages(trials: Sequence[Trial]) -> list[str]:
    """Return the stage with which each test shares its contact's error; empty where it has none."""
    stages = [trial.test.contact_stage for trial in trials]
    return [stage if stages.count(stage) > 1 else "" for stage in stages]


def stage_changes(trials: Sequence[Trial], blocks: Blocks) -> Array:
    """Return what one standard error of each of S stages' contacts changes, (S, T, B) in N."""
    stages, changes = np.array(shared_stages(trials)), np.asarray(blocks.stage)
    names = dict.fromkeys(stage for stage in stages.tolist() if stage)
    rows = [np.where((stages == name)[:, None], changes, 0.0) for name in names]
    return np.reshape([row for row in rows if row.any()], (-1, *changes.shape))


def _basis(matrix: Array) -> tuple[Array, Array]:
    """Return 1/sqrt(lambda) of a covariance, and rows of lambda^{-1/2} V^T or their diagonal."""
    if np.count_nonzero(matrix) == len(matrix):  # independent noise
        roots = np.diag(matrix) ** -0.5
        return roots, roots
    values, vectors = np.linalg.eigh(matrix)
    roots = np.maximum(values, _SINGULAR * values.max(initial=0.0)) ** -0.5
    return roots, roots[:, None] * vectors.T


def covariance(floor: NoiseFloor, blocks: Blocks, peak: float) -> np.ndarray:
    """Return the covariance (N, N) of the noise of one test's block means (N^2)."""
    first, last, count, weight, scale, extra, timing, zero, tare = map(
        np.asarray,
        (
            *(blocks.first, blocks.last, blocks.count, blocks.weight),
            *(blocks.scale, blocks.extra, blocks.timing, blocks.zero, blocks.tare),
        ),
    )
    white = (floor.white * weight * scale) ** 2 / count + timing**2 + (_LEAST * peak) ** 2
    correlated = floor.ou**2 * np.outer(scale, scale)
    correlation = averaged_correlation(first, last, count, floor.tau)
    moving = (extra > 0.0).astype(float)
    group = np.cumsum(np.abs(np.diff(moving, prepend=moving[:1])))
    common = np.where(group[:, None] == group, 0.5, 0.0)
    motion = np.outer(extra, extra) * (common + 0.5 * np.eye(extra.size))
    zeros = np.outer(zero, zero) + np.outer(tare, tare)
    return np.diag(white) + correlated * correlation + motion + zeros


def expected_covariance(floor: NoiseFloor, blocks: Blocks, peak: float) -> Array:
    """Return the mean `covariance` (N, N) of floors that are likely given the dwells (N^2)."""
    floors, weights = floor.likely()
    total = np.zeros((blocks.first.size, blocks.first.size))
    for one, weight in zip(floors, weights.tolist(), strict=True):
        total += weight * covariance(one, blocks, peak)
    return total


def averaged_correlation(
    first: np.ndarray, last: np.ndarray, count: np.ndarray, tau: float
) -> np.ndarray:
    """Return the correlation (N, N) of means over ``count`` readings of a unit process."""
    mean = regression(last - first, count, tau)
    gap = np.maximum(first[None, :] - last[:, None], 0.0)
    averaged = np.exp(-(gap + gap.T) / tau) * np.outer(mean, mean)
    np.fill_diagonal(averaged, variance(last - first, count, tau))
    return averaged
