"""Leave one test out: what a model predicts of each test from all the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.otherform import OtherForm
from qlvbayes.diagnosis.samples import Samples, rmse
from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble
from qlvbayes.inference.together import together

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

    def refit(weight: np.ndarray) -> Point:
        return climb(ensemble, point.subset, point.theta, weight, _STEPS)

    def predict(points: list[Point]) -> list[list[np.ndarray]]:
        return samples.predict(np.stack([p.constants for p in points]))

    return _left_out(samples, point, refit, predict)


def form_held_out(form: OtherForm, samples: Samples, point: Point) -> HeldOut:
    """The same of an effect in another form."""

    def refit(weight: np.ndarray) -> Point:
        return form.fit(point, weight, _STEPS)

    def predict(points: list[Point]) -> list[list[np.ndarray]]:
        return form.predict(samples, points)

    return _left_out(samples, point, refit, predict)


def _left_out(
    samples: Samples,
    point: Point,
    refit: Callable[[np.ndarray], Point],
    predict: Callable[[list[Point]], list[list[np.ndarray]]],
) -> HeldOut:
    count = len(samples.trials)
    points = together(refit, 1.0 - np.eye(count)) if count > 1 else [point]
    predicted = predict(points)
    residuals = [
        observed - forces[k]
        for k, (observed, forces) in enumerate(zip(samples.observed, predicted, strict=True))
    ]
    score = -sum(float(p.losses[k]) for k, p in enumerate(points))
    return HeldOut(rmse(residuals), score, tuple(rmse([r]) for r in residuals))
