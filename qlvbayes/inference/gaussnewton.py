"""The highest point of a posterior by damped Gauss-Newton steps, and Laplace's evidence there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from qlvbayes.inference import linearised
from qlvbayes.inference.subset import Ensemble, Part, Subset
from qlvbayes.model.noise import AbstractGaussian, AbstractNoise

CHUNK = 10  # directions along which the model is run at once
ROUND = 16  # directions come in multiples of this, so that few sizes are compiled
_ENOUGH = 5e-3  # expected rise of the log density below which the climb ends
_CREEP = 0.02  # rise of the log density in a step on a ridge at which the climb ends
_STEPS = 30
_HOPE = {2: 20.0, 5: 10.0, 10: 5.0}  # from which step on it may bring how often what it promises
_LEAST_DAMPING = 1e-4  # from less, it takes many vain steps to turn in a bent valley
_FARTHEST = 3.0  # longest step in a unit of theta


@dataclass(frozen=True, eq=False)
class Point:
    """A place in the posterior: theta (D,) of the whole, and what was found there.

    loss: minus log density; losses (T,): minus log likelihood of each test; gradient (F,) and
    curvature (F, F) of the loss over the free numbers.
    """

    subset: Subset
    theta: np.ndarray
    constants: np.ndarray
    loss: float
    losses: np.ndarray
    gradient: np.ndarray
    curvature: np.ndarray
    slopes: np.ndarray

    @property
    def log_evidence(self) -> float:
        """Laplace: log density + (F/2) log 2 pi - (1/2) log det curvature."""
        sign, log_det = np.linalg.slogdet(self.curvature)
        if sign <= 0:
            return -math.inf
        return -self.loss + 0.5 * (self.gradient.size * math.log(2.0 * math.pi) - log_det)

    @property
    def covariance(self) -> np.ndarray:
        """(F, F) over the free numbers."""
        return np.linalg.inv(self.curvature)


def evaluate(
    ensemble: Ensemble, subset: Subset, theta: np.ndarray, weight: np.ndarray | None = None
) -> Point:
    """Density and its derivatives over the free numbers; tests count by ``weight`` (T,)."""
    posterior = ensemble.posterior
    terms = linearised.prior_terms(posterior, theta)
    constants = subset.nulled(np.asarray(terms.constants))
    slopes = np.asarray(terms.slopes)[:, subset.theta] * np.isnan(subset.null)[:, None]
    judged = judge(ensemble, constants, slopes.T)
    weight = np.ones(judged.loss.shape[0]) if weight is None else weight
    free = subset.theta
    hessian = np.asarray(terms.hessian)[np.ix_(free, free)]
    count = free.size
    losses = np.asarray(judged.loss)
    return Point(
        subset=subset,
        theta=theta,
        constants=constants,
        loss=float(weight @ losses - np.asarray(terms.log_prior)[subset.priors].sum()),
        losses=losses,
        gradient=weight @ np.asarray(judged.gradient)[:, :count] - np.asarray(terms.gradient)[free],
        curvature=np.einsum("t,tij->ij", weight, np.asarray(judged.information)[:, :count, :count])
        + positive_part(-hessian),
        slopes=slopes,
    )


def judge(
    ensemble: Ensemble, constants: np.ndarray, directions: np.ndarray
) -> linearised.LikelihoodTerms:
    """Likelihood of constants (P,) and its derivatives along directions (K, P), padded with 0."""
    posterior = ensemble.posterior
    padded = pad_directions(directions)
    predicted, slopes = predict_along(ensemble, constants, padded)
    noise, noise_slopes = noise_along(posterior.noise, constants, padded)
    return linearised.likelihood_terms(noise, noise_slopes, posterior.record, predicted, slopes)


def predict_along(
    ensemble: Ensemble, constants: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Block means (T, B) and their slopes (K, T, B) along directions (K, P).

    Only directions that move the model are run, ten at a time, each on the cheapest part.
    """
    noise = len(ensemble.posterior.noise.units)
    moving = np.flatnonzero(directions[:, :-noise].any(axis=1))
    groups: dict[Part, list[int]] = {} if moving.size else {ensemble.part(constants): []}
    for row in moving.tolist():
        groups.setdefault(ensemble.part(constants, directions[row]), []).append(row)
    slopes = np.zeros((len(directions), *ensemble.posterior.record.blocks.force.shape))
    for part, rows in groups.items():
        for first in range(0, max(len(rows), 1), CHUNK):
            some = rows[first : first + CHUNK]
            along = np.zeros((CHUNK, part.constants.size))
            along[: len(some)] = directions[some][:, part.constants]
            at = constants[part.constants]
            predicted, found = linearised.predictions_along(part.posterior, at, along)
            slopes[some] = np.asarray(found)[: len(some)]
    return np.asarray(predicted), slopes


def pad_directions(directions: np.ndarray) -> np.ndarray:
    """(K, P) filled up with zero rows to a multiple of 16."""
    missing = -len(directions) % ROUND
    return np.concatenate([directions, np.zeros((missing, directions.shape[1]))])


def noise_along(
    noise: AbstractNoise, constants: np.ndarray, directions: np.ndarray
) -> tuple[AbstractGaussian, AbstractGaussian]:
    """The noise at the last constants, and its constants' slopes along directions (K, P)."""
    count = len(noise.units)
    kind = cast(Callable[..., AbstractGaussian], type(noise))
    return kind(*constants[-count:]), kind(*directions[:, -count:].T)


def positive_part(matrix: np.ndarray) -> np.ndarray:
    """Symmetric part with negative eigenvalues taken as 0; 0 where the density has overflowed."""
    if not np.isfinite(matrix).all():
        return np.zeros_like(matrix)
    if matrix.size == 1:
        return np.maximum(matrix, 0.0)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def climb(
    ensemble: Ensemble,
    subset: Subset,
    theta: np.ndarray,
    weight: np.ndarray | None = None,
    steps: int = _STEPS,
    worth: float = -math.inf,
) -> Point:
    """Climb from theta to the highest point of a subset; see ``ascend``."""

    def at(place: np.ndarray) -> Point:
        return evaluate(ensemble, subset, place, weight)

    return ascend(at, theta, subset.theta, steps, worth)


def ascend(
    at: Callable[[np.ndarray], Point],
    start: np.ndarray,
    free: np.ndarray,
    steps: int = _STEPS,
    worth: float = -math.inf,
) -> Point:
    """Levenberg-Marquardt until a step promises no more than 0.005 in log density.

    at: evaluates a place, of whose numbers those at ``free`` may move; worth: a log evidence; once
    a step does not promise to reach it, the climb is given up.
    """
    point = at(start)
    if not np.isfinite(point.loss):
        return point
    damping = 1e-3
    hopes = _HOPE.items()
    for k in range(steps):
        step, promise = _step(point, damping)
        if promise < _ENOUGH and damping <= 1.0:
            break
        if any(k >= least and point.log_evidence + hope * promise < worth for least, hope in hopes):
            break
        moved = point.theta.copy()
        moved[free] += step
        tried = at(moved)
        if np.isfinite(tried.loss) and tried.loss < point.loss:
            if max(point.loss - tried.loss, 0.2 * promise) < _CREEP:
                return tried
            gain = (point.loss - tried.loss) / promise
            damping *= 0.1 if gain > 0.5 else 1.0 if gain > 0.1 else 4.0
            damping = max(damping, _LEAST_DAMPING)
            point = tried
        else:
            damping *= 10.0
            if damping > 1e9:
                break
    return point


def _step(point: Point, damping: float) -> tuple[np.ndarray, float]:
    """A damped step (F,) no longer than 3 in any number, and the fall of the loss it promises."""
    scale = np.diag(point.curvature)
    matrix = point.curvature + damping * np.diag(np.maximum(scale, 1e-8 * scale.max()))
    step = -cho_solve(cho_factor(matrix + 1e-14 * scale.max() * np.eye(scale.size)), point.gradient)
    step *= min(1.0, _FARTHEST / max(float(np.max(np.abs(step))), 1e-300))
    promise = -(point.gradient @ step + 0.5 * step @ point.curvature @ step)
    return step, float(promise)
