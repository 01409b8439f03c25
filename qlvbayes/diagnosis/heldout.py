r"""Leave one test out: what a model predicts of each test from all the others.

Two errors of it: in newtons, and weighed by the noise at rest, whose covariance Sigma was measured
without the model, :math:`\sqrt{e^T \Sigma^{-1} e / n}`, 1 where only noise is left. Noise with a
memory moves the first by a few per cent whatever the model, and a fit's own noise could swell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from qlvbayes.diagnosis.forms.otherform import AbstractOtherForm
from qlvbayes.diagnosis.samples import Samples, rmse
from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.linearised import whitened
from qlvbayes.inference.subset import Ensemble
from qlvbayes.inference.together import together

_STEPS = 12


@dataclass(frozen=True)
class HeldOut:
    """Errors on tests that were not fitted.

    rmse: over all samples (N); weighed: the same in sds of the noise at rest, its memory allowed
    for; score: log density of the tests, summed; by_test: rmse of each.
    """

    rmse: float
    weighed: float
    score: float
    by_test: tuple[float, ...]


def held_out(ensemble: Ensemble, samples: Samples, point: Point) -> HeldOut:
    """Refit with each test left out in turn, from the optimum of all. One test predicts itself."""

    def refit(weight: np.ndarray) -> Point:
        return climb(ensemble, point.subset, point.theta, weight, _STEPS)

    def predict(points: list[Point]) -> list[list[np.ndarray]]:
        return samples.predict(np.stack([p.constants for p in points]))

    return _left_out(samples, point, refit, predict)


def form_held_out(form: AbstractOtherForm, samples: Samples, point: Point) -> HeldOut:
    """The same of an effect in another form."""

    def refit(weight: np.ndarray) -> Point:
        return form.fit(point, weight, _STEPS)

    def predict(points: list[Point]) -> list[list[np.ndarray]]:
        constants = np.stack([p.constants for p in points])
        return form.predict(samples, constants, np.stack([form.split(p.theta)[1] for p in points]))

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
    by_test = tuple(rmse([r]) for r in residuals)
    return HeldOut(rmse(residuals), _weighed(samples, residuals), score, by_test)


def _weighed(samples: Samples, residuals: list[np.ndarray]) -> float:
    """Root mean square of residuals whitened by the noise at rest."""
    full = np.zeros(np.asarray(samples.record.blocks.real).shape)
    for row, residual in zip(full, residuals, strict=True):
        row[: residual.size] = residual
    white = np.asarray(whitened(samples.noise, samples.record, jnp.asarray(full[None])))
    return float(np.sqrt(np.sum(white**2) / sum(r.size for r in residuals)))
