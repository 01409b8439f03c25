r"""Add errors to a noise floor that several tests share, such as that of one stage's contact.

The floor's covariance is that of each test alone. An error common to tests, with the change
:math:`u` of the block means for one standard error, adds :math:`u u^T`, which joins them. It is an
unknown constant with a normal prior, integrated out to first order. With whitened changes
:math:`\tilde U = L\, \text{diag}(s)\, R^T`,

.. math:: \tilde x' = \left(1 - R\, \text{diag}(1 - (1 + s^2)^{-1/2})\, R^T\right) \tilde x

is white. Additional independent noise is taken to be what it is without the shared errors, which in
their few directions R makes it larger than it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.whitening import Whitener
from qlvbayes.io.arrays import Array
from qlvbayes.motion.experiment import Trial
from qlvbayes.motion.record import Blocks


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


def with_common_errors(discrepancy: Discrepancy, changes: Array) -> Discrepancy:
    """Return the discrepancy under noise to which errors with changes (S, T, B) are added."""
    if not len(changes):
        return discrepancy
    whitener = discrepancy.whitener
    return discrepancy.with_whitener(_joined(whitener, whitener.flattened(changes)))


def joint_covariance(whitener: Whitener) -> Array:
    """Return the covariance (n, n) of the block means of all tests (N^2)."""
    own = np.asarray(block_diag(*whitener.covariances))
    if isinstance(whitener, JointWhitener):
        own += whitener.common.T @ whitener.common
    return own


@dataclass(frozen=True, eq=False)
class JointWhitener(Whitener):
    """The whitening of tests that share S errors.

    common (S, n): changes of the block means (N) for one standard error of each.
    """

    common: Array

    @property
    def sds(self) -> Array:
        """Return the sd (n,) of the noise of each block mean (N)."""
        return np.sqrt(super().sds ** 2 + np.sum(self.common**2, axis=0))

    def without(self, left_out: NDArray[np.bool_]) -> Whitener:
        """Return the whitener without some of the n blocks, which left_out (n,) marks."""
        return _joined(super().without(left_out), self.common[:, ~left_out])

    @property
    def matrix(self) -> Array:
        """Return the matrix (n, n) that whitens the block means of all tests, joined."""
        own = super().matrix
        axes, less = self._turn
        return np.asarray(own - (axes * less) @ (axes.T @ own))

    def whiten(self, vectors: Array) -> Array:
        """Return (M, n) whitened."""
        own = super().whiten(vectors)
        axes, less = self._turn
        return np.asarray(own - ((own @ axes) * less) @ axes.T)

    @cached_property
    def _turn(self) -> tuple[Array, Array]:
        """Return directions (n, S) of the shared errors, and the shares (S,) to take off."""
        _, sizes, axes = np.linalg.svd(super().whiten(self.common), full_matrices=False)
        return axes.T, 1.0 - (1.0 + sizes**2) ** -0.5


def _joined(whitener: Whitener, common: Array) -> JointWhitener:
    joint = JointWhitener(whitener.blocks, whitener.covariances, whitener.timing, common)
    joint.__dict__["_bases"] = whitener._bases  # those of the tests alone, which are known
    return joint
