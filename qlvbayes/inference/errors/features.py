r"""Give the smooth functions of which a discrepancy is made, by a few features.

The smooth functions are those of a Gaussian process of covariance

.. math:: k(x, x') = g g' [phase = phase'] k_t k_d (\tfrac12 k_v + \tfrac12 [test = test'])

with Matern-3/2 correlations over the logarithm of the time since the phase began, over the depth
and over the logarithm of the loading rate (Kennedy & O'Hagan 2001, doi:10.1111/1467-9868.00294). It
is the sum of one function that all tests share and one for each test. g is 1 where the force is
largest and a half where there is none; `DiscrepancyPrior` states these values and the correlation
lengths. The pivoted Cholesky factor gives features phi at any location, with k(x, x') = sum_m
phi_m(x) phi_m(x') (Harbrecht et al. 2012, doi:10.1016/j.apnum.2011.10.001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from qlvbayes.io.arrays import Array
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import KINDS, phase_index
from qlvbayes.motion.record import Blocks

_MAX_FEATURES = 160
_LEFT_OUT = 1e-3  # share of the largest variance that features may leave out anywhere


@dataclass(frozen=True)
class DiscrepancyPrior:
    """The prior of a discrepancy before any test.

    The smooth part changes over the time since the phase began, the depth and the loading rate.
    """

    none: Annotated[float, "prior probability that the model leaves no systematic error"] = 0.5
    # with ``sizes`` values, evenly spaced in the logarithm; noise hides anything below the smallest
    smallest: Annotated[float, "smallest systematic error over the peak force"] = 3e-4
    largest: Annotated[float, "largest systematic error over the peak force"] = 0.3
    sizes: Annotated[int, "number of sizes of the systematic error that are tried"] = 19
    # independent from block to block; small because curves of soft bodies have few kinks
    rough: Annotated[float, "variance of its rough part over that of its smooth part"] = 0.1
    time: Annotated[float, "e-folds of time over which it changes"] = 2.0
    depth: Annotated[float, "share of the largest depth over which it changes"] = 0.3
    rate: Annotated[float, "e-folds of the loading rate over which it changes"] = 2.0
    unloaded: Annotated[float, "its size at zero force over that at the largest force"] = 0.5

    @property
    def shares(self) -> Array:
        """Return the sizes (S,) over the peak force, zero left out."""
        return np.geomspace(self.smallest, self.largest, self.sizes)

    def smooth(self, time: Array, depth: Array, rate: Array) -> Array:
        """Return coordinates (N, 3) in correlation lengths."""
        return np.stack([np.log(time) / self.time, depth / self.depth, np.log(rate) / self.rate], 1)

    def size(self, share: Array) -> Array:
        """Return the size g (N,) at shares of the largest force."""
        return self.unloaded + (1.0 - self.unloaded) * np.minimum(np.abs(share), 1.0)


UNDECIDED = DiscrepancyPrior()


@dataclass(frozen=True, eq=False)
class Locations:
    """The N points at which the smooth functions are evaluated."""

    # (N, 3): log time since the phase began, depth and log rate, each in correlation lengths
    smooth: Array
    size: Array  # (N,): g
    phase: NDArray[np.intp]  # (N,): index of the kind of phase
    test: NDArray[np.intp]  # (N,): index of the test

    @classmethod
    def from_trial(
        cls,
        experiment: Experiment,
        trial: Trial,
        test: int,
        time: Array,
        force: Array,
        prior: DiscrepancyPrior = UNDECIDED,
    ) -> Locations:
        """Return the locations at times (s) of one trial, where the force is ``force`` (N)."""
        scales = experiment.scales
        starts = np.array([phase.start for phase in trial.phases])
        which = phase_index(trial.phases, time)
        kinds = np.array([KINDS.index(phase.kind) for phase in trial.phases])
        smooth = prior.smooth(
            np.maximum(time - starts[which], 0.0) + scales.shortest,
            trial.trajectory.displacement(time) / scales.depth,
            np.full(time.shape, max(trial.rate, 1e-9)),
        )
        size = prior.size(force / scales.force)
        return cls(smooth, size, kinds[which], np.full(time.shape, test))

    @classmethod
    def from_blocks(
        cls,
        experiment: Experiment,
        trials: Sequence[Trial],
        blocks: Blocks,
        prior: DiscrepancyPrior = UNDECIDED,
    ) -> Locations:
        """Return the locations in the middle of the blocks (T, B) of some trials."""
        names = [trial.name for trial in experiment.trials]
        force, first, last, real = (
            np.asarray(x) for x in (blocks.force, blocks.first, blocks.last, blocks.real)
        )
        middle = 0.5 * (first + last)
        return cls.joined(
            [
                cls.from_trial(
                    experiment, trial, names.index(trial.name), middle[k, own], force[k, own], prior
                )
                for k, (trial, own) in enumerate(zip(trials, real, strict=True))
            ]
        )

    def __getitem__(self, rows: NDArray[np.intp]) -> Locations:
        """Return the locations at some indices."""
        return Locations(self.smooth[rows], self.size[rows], self.phase[rows], self.test[rows])

    @classmethod
    def joined(cls, parts: Sequence[Locations]) -> Locations:
        """Return the locations of all parts, one part after another."""
        fields = zip(*((p.smooth, p.size, p.phase, p.test) for p in parts), strict=True)
        return cls(*map(np.concatenate, fields))


def covariance(one: Locations, two: Locations) -> Array:
    """Return the covariance (N, M) of a smooth part of unit size between two sets of locations."""
    time, depth, rate = (
        _matern(np.abs(one.smooth[:, None, k] - two.smooth[None, :, k])) for k in range(3)
    )
    correlated = time * depth * np.outer(one.size, two.size) * (one.phase[:, None] == two.phase)
    return correlated * 0.5 * (rate + (one.test[:, None] == two.test))


def _matern(distance: Array) -> Array:
    """Return the Matern-3/2 correlation at distances in correlation lengths."""
    scaled = np.sqrt(3.0) * distance
    return (1.0 + scaled) * np.exp(-scaled)


@dataclass(frozen=True, eq=False)
class Features:
    """The features at any location, determined by M pivots and their Cholesky factor (M, M)."""

    pivots: Locations
    factor: Array

    @classmethod
    def from_locations(cls, locations: Locations) -> Features:
        """Return as many features as leave little variance out at the locations, 160 at most."""
        remaining = locations.size**2
        limit = _LEFT_OUT * float(remaining.max())
        pivots: list[int] = []
        factor = np.zeros((0, remaining.size))
        while len(pivots) < min(_MAX_FEATURES, remaining.size) and remaining.max() > limit:
            k = int(np.argmax(remaining))
            column = covariance(locations[np.array([k])], locations)[0]
            row = (column - factor[:, k] @ factor) / np.sqrt(remaining[k])
            factor = np.concatenate([factor, row[None]])
            remaining = np.maximum(remaining - row**2, 0.0)
            remaining[k] = 0.0
            pivots.append(k)
        rows = np.array(pivots)
        return cls(locations[rows], factor[:, rows].T)

    def __call__(self, locations: Locations) -> Array:
        """Return the features (M, N) at N locations."""
        cross = covariance(self.pivots, locations)
        return np.asarray(solve_triangular(self.factor, cross, lower=True))
