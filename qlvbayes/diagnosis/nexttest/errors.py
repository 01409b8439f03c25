"""The errors of readings against a model's force: the noise floor, and what the model misses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.records import locations_of
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.inference.errors.features import UNDECIDED
from qlvbayes.inference.errors.features import covariance as smooth_covariance
from qlvbayes.inference.errors.whitening import covariance as floor_covariance
from qlvbayes.io.arrays import Array
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.record import Record


@dataclass(frozen=True, eq=False)
class ReadingErrors:
    """The errors of readings in any test of a pad."""

    floor: NoiseFloor  # noise floor of the load cell
    peak: float  # largest force (N)
    # size (N) of the discrepancy that the diagnosis left in addition to the effects that it names;
    # 0 where it left none
    missed: float = 0.0

    @cached_property
    def expected(self) -> NoiseFloor:
        """The floor with all that the dwells leave open averaged over."""
        return self.floor.expected()

    def covariance(self, design: Design, rig: Rig, record: Record, force: Array) -> Array:
        """Return the covariance (n, n) of the block means of one design (N^2)."""
        real = np.asarray(record.blocks.real)
        own = jax.tree.map(lambda x: np.asarray(x)[real], record.blocks)
        own = replace(own, scale=self.floor.scale(force[real]))
        total = floor_covariance(self.expected, own, self.peak)
        if self.missed > 0.0:
            middle = 0.5 * (own.first + own.last)
            locations = locations_of(design, rig, middle, force[real], self.peak)
            smooth = smooth_covariance(locations, locations)
            total = total + self.missed**2 * (smooth + UNDECIDED.rough * np.eye(middle.size))
        return np.asarray(total)


@dataclass(frozen=True, eq=False)
class Whitening:
    """The map from block means (B,) of one design to independent values (n,) of unit variance."""

    real: NDArray[np.bool_]  # which block means (B,) are no padding
    covariance: Array  # covariance (n, n) of these (N^2)

    @cached_property
    def _root(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)

    def __call__(self, vectors: Array) -> Array:
        """Return whitened vectors (..., n) of vectors (..., B)."""
        flat = vectors[..., self.real].reshape(-1, int(self.real.sum()))
        white = solve_triangular(self._root, flat.T, lower=True, check_finite=False).T
        shaped: Array = white.reshape(*vectors.shape[:-1], -1).astype(np.float64)
        return shaped
