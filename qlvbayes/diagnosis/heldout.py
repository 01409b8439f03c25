"""Leave one test out: what a model predicts of each test from all the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.samples import Samples, rmse
from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble

_STEPS = 12


@dataclass(frozen=True)
class HeldOut:
    """Errors on tests that were not fitted.

    rmse: over all samples (N); score: log density of the tests, summed; by_test: rmse of each.
    """

    rmse: float
    score: float
    by_test: tuple[float, ...]


def held_out(ensemble: Ensemble, samples: Samples, point: Point) -> HeldOut:
    """Refit with each test left out in turn, from the optimum of all. One test predicts itself."""
    count = len(samples.trials)
    if count == 1:
        residuals = samples.residuals(point.constants)
        return HeldOut(rmse(residuals), -float(point.losses[0]), (rmse(residuals),))
    points = [
        climb(ensemble, point.subset, point.theta, 1.0 - np.eye(count)[k], _STEPS)
        for k in range(count)
    ]
    predicted = samples.predict(np.stack([p.constants for p in points]))
    residuals = [
        trial.test.force[rows] - predicted[k][k]
        for k, (trial, rows) in enumerate(zip(samples.trials, samples.rows, strict=True))
    ]
    score = -sum(float(p.losses[k]) for k, p in enumerate(points))
    return HeldOut(rmse(residuals), score, tuple(rmse([r]) for r in residuals))
