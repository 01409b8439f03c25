r"""Smooth functions of what a test does, by a few features: what a discrepancy is made of.

A Gaussian process of covariance

.. math:: k(x, x') = g g' [phase = phase'] k_t k_d (\tfrac12 k_v + \tfrac12 [test = test'])

with Matern-3/2 correlations over the logarithm of the time since the phase began, the depth and the
logarithm of the loading rate (Kennedy & O'Hagan 2001, doi:10.1111/1467-9868.00294): one function
that all tests share, and one of each test's own. g is 1 where the force is largest and a half where
there is none (`DiscrepancyPrior`, as the lengths of correlation). Its pivoted Cholesky factor gives
features phi (Harbrecht et al. 2012, doi:10.1016/j.apnum.2011.10.001),
k(x, x') = sum_m phi_m(x) phi_m(x'), at any place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import KINDS, phase_index
from qlvbayes.motion.record import Blocks

Array = NDArray[np.float64]

_MOST = 160  # features
_ENOUGH = 1e-3  # of the variance, that features may leave out anywhere


@dataclass(frozen=True)
class DiscrepancyPrior:
    """What a discrepancy may be before any test.

    none: prior probability that there is none, as undecided as can be; smallest, largest: sizes
    that it may have over the peak force, of which there are ``sizes``, evenly spaced in the
    logarithm (below the smallest, noise hides it); rough: variance of the part that is independent
    from block to block over that of the smooth one: smooth first of all, as no curve of a soft body
    has many kinks.

    time (e-folds of the time since the phase began), depth (share of the largest), rate (e-folds of
    the loading rate): over which the smooth part changes; unloaded: its size where there is no
    force, over that where the force is largest.
    """

    none: float = 0.5
    smallest: float = 3e-4
    largest: float = 0.3
    sizes: int = 19
    rough: float = 0.1
    time: float = 2.0
    depth: float = 0.3
    rate: float = 2.0
    unloaded: float = 0.5

    @property
    def shares(self) -> Array:
        """(S,) sizes over the peak force, without none."""
        return np.geomspace(self.smallest, self.largest, self.sizes)

    def smooth(self, time: Array, depth: Array, rate: Array) -> Array:
        """(N, 3) of times since a phase began (s), shares of the largest depth, rates (1/s)."""
        return np.stack([np.log(time) / self.time, depth / self.depth, np.log(rate) / self.rate], 1)

    def size(self, share: Array) -> Array:
        """(N,) g at some shares of the largest force."""
        return self.unloaded + (1.0 - self.unloaded) * np.minimum(np.abs(share), 1.0)


UNDECIDED = DiscrepancyPrior()


@dataclass(frozen=True, eq=False)
class Places:
    """Where the functions are looked at, each (N,).

    smooth (N, 3): log time since the phase began, depth, log rate, each over the length within
    which the functions change; size: g; phase: its kind; test: which.
    """

    smooth: Array
    size: Array
    phase: NDArray[np.intp]
    test: NDArray[np.intp]

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        trial: Trial,
        test: int,
        time: Array,
        force: Array,
        prior: DiscrepancyPrior = UNDECIDED,
    ) -> Places:
        """At some times (s) of one trial, where the force is ``force`` (N)."""
        scales = experiment.scales
        starts = np.array([phase.start for phase in trial.phases])
        place = phase_index(trial.phases, time)
        kinds = np.array([KINDS.index(phase.kind) for phase in trial.phases])
        smooth = prior.smooth(
            np.maximum(time - starts[place], 0.0) + scales.shortest,
            trial.trajectory.displacement(time) / scales.depth,
            np.full(time.shape, max(trial.rate, 1e-9)),
        )
        size = prior.size(force / scales.force)
        return cls(smooth, size, kinds[place], np.full(time.shape, test))

    @classmethod
    def of_blocks(
        cls,
        experiment: Experiment,
        trials: Sequence[Trial],
        blocks: Blocks,
        prior: DiscrepancyPrior = UNDECIDED,
    ) -> Places:
        """In the middle of every block (T, B) of some trials of a pad, padding left out."""
        names = [trial.name for trial in experiment.trials]
        force, first, last, real = (
            np.asarray(x) for x in (blocks.force, blocks.first, blocks.last, blocks.real)
        )
        middle = 0.5 * (first + last)
        return cls.joined(
            [
                cls.of(
                    experiment, trial, names.index(trial.name), middle[k, own], force[k, own], prior
                )
                for k, (trial, own) in enumerate(zip(trials, real, strict=True))
            ]
        )

    def __getitem__(self, rows: NDArray[np.intp]) -> Places:
        """Some of them."""
        return Places(self.smooth[rows], self.size[rows], self.phase[rows], self.test[rows])

    @classmethod
    def joined(cls, parts: Sequence[Places]) -> Places:
        """One after another."""
        fields = zip(*((p.smooth, p.size, p.phase, p.test) for p in parts), strict=True)
        return cls(*map(np.concatenate, fields))


def covariance(one: Places, two: Places) -> Array:
    """(N, M), of unit size."""
    time, depth, rate = (
        _matern(np.abs(one.smooth[:, None, k] - two.smooth[None, :, k])) for k in range(3)
    )
    near = time * depth * np.outer(one.size, two.size) * (one.phase[:, None] == two.phase)
    return near * 0.5 * (rate + (one.test[:, None] == two.test))


def _matern(apart: Array) -> Array:
    far = np.sqrt(3.0) * apart
    return (1.0 + far) * np.exp(-far)


@dataclass(frozen=True, eq=False)
class Features:
    """Features at any place, from those of a few: places (M,) and their Cholesky factor (M, M)."""

    pivots: Places
    factor: Array

    @classmethod
    def of(cls, places: Places) -> Features:
        """As many as leave little out at some places."""
        left = places.size**2
        limit = _ENOUGH * float(left.max())
        chosen: list[int] = []
        found = np.zeros((0, left.size))
        while len(chosen) < min(_MOST, left.size) and left.max() > limit:
            k = int(np.argmax(left))
            column = covariance(places[np.array([k])], places)[0]
            row = (column - found[:, k] @ found) / np.sqrt(left[k])
            found = np.concatenate([found, row[None]])
            left = np.maximum(left - row**2, 0.0)
            left[k] = 0.0
            chosen.append(k)
        rows = np.array(chosen)
        return cls(places[rows], found[:, rows].T)

    def __call__(self, places: Places) -> Array:
        """(M, N)."""
        cross = covariance(self.pivots, places)
        return np.asarray(solve_triangular(self.factor, cross, lower=True))
