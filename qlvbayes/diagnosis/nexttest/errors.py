"""What stands between a model's force and a reading: the noise floor, and what the model misses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.records import places_of
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.inference.errors.features import UNDECIDED
from qlvbayes.inference.errors.features import covariance as smooth_covariance
from qlvbayes.inference.errors.whitening import covariance as floor_covariance
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Errors:
    """Of any test of a pad.

    floor: of the load cell; peak: largest force (N); missed: size (N) of the discrepancy that the
    diagnosis found beside what it names, 0 where it found none.
    """

    floor: NoiseFloor
    peak: float
    missed: float = 0.0

    def covariance(self, design: Design, rig: Rig, record: Record, force: Array) -> Array:
        """(n, n) of the block means of one design (a record without leading axis), N^2.

        force (B,): about what will be measured, by which noise may grow.
        """
        real = np.asarray(record.blocks.real)
        own = jax.tree.map(lambda x: np.asarray(x)[real], record.blocks)
        own = replace(own, scale=self.floor.scale(force[real]))
        found = floor_covariance(self.floor, own, self.peak)
        if self.missed > 0.0:
            middle = 0.5 * (own.first + own.last)
            places = places_of(design, rig, middle, force[real], self.peak)
            shared = smooth_covariance(places, places) + UNDECIDED.rough * np.eye(middle.size)
            found = found + self.missed**2 * shared
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Whitening:
    """Block means (B,) of one design as independent numbers (n,) of unit variance."""

    real: NDArray[np.bool_]
    covariance: Array

    @cached_property
    def _root(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)

    def __call__(self, vectors: Array) -> Array:
        """(..., B) to (..., n)."""
        flat = vectors[..., self.real].reshape(-1, int(self.real.sum()))
        found = solve_triangular(self._root, flat.T, lower=True, check_finite=False).T
        shaped: Array = found.reshape(*vectors.shape[:-1], -1).astype(np.float64)
        return shaped
