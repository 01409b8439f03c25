"""Leave one test out: what a hypothesis predicts of each test from all the others.

Of one test alone its phases are left out, one after another.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.samples import Samples, rmse
from qlvbayes.diagnosis.search import Weighed
from qlvbayes.inference.density import Density
from qlvbayes.inference.modes import find_mode
from qlvbayes.kinematics.phases import phase_index

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class HeldOut:
    """Root mean square errors (N) on what was not fitted: over all samples, of each part left out.

    Both are nan where there is one test of one phase only, which nothing predicts.
    """

    rmse: float
    by_part: tuple[float, ...]


def held_out(density: Density, samples: Samples, found: Weighed) -> HeldOut:
    """Refit with each test (or phase) left out in turn, from the mode of all."""
    residuals = []
    for blocks, test, rows in _parts(density, samples):
        mode = find_mode(density.without(blocks), found.hypothesis, found.point.theta)
        point = mode.point if mode is not None else found.point
        predicted = samples.predict(found.hypothesis, point.constants[None])
        residuals.append((samples.observed[test] - predicted[test][0])[rows])
    if not residuals:
        return HeldOut(math.nan, ())
    return HeldOut(rmse(residuals), tuple(rmse([one]) for one in residuals))


def _parts(density: Density, samples: Samples) -> Iterator[tuple[Mask, int, Mask]]:
    """What is left out in turn: of the block means (n,), which test, of its samples."""
    count = len(samples.trials)
    if count > 1:
        for k in range(count):
            yield density.whitener.tests == k, k, np.ones(samples.rows[k].size, dtype=bool)
        return
    (trial,) = samples.trials
    blocks = density.space.record.blocks
    middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))[0, density.space.real[0]]
    of_blocks = phase_index(trial.phases, middle)
    of_samples = phase_index(trial.phases, trial.test.time[samples.rows[0]])
    for k in range(len(trial.phases)):
        out, rows = of_blocks == k, of_samples == k
        if rows.any() and out.any() and not out.all():
            yield out, 0, rows
