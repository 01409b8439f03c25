"""Force curves of a diagnosis' first and last model, with bands that hold 90 % of samples."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np
from scipy.special import ndtri

from qlvbayes.diagnosis.search import Step
from qlvbayes.diagnosis.verdict import Diagnosis, Work
from qlvbayes.experiment import Trial
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.linearised import prior_terms
from qlvbayes.inference.subset import Ensemble

_BAND = (0.05, 0.95)
_NOISES = ndtri((np.arange(20) + 0.5) / 20.0)  # noise of each draw, at even quantiles


@dataclass(frozen=True, eq=False)
class Band:
    """Force of one model at one test's samples (n,).

    mean: at the constants of highest density; low, high: 5 % and 95 % quantiles of single readings,
    from Laplace's approximation of the constants plus the model's noise.
    """

    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Curve:
    """One test's samples (n,), measured and by two models.

    phase: kind of phase; floor: sd of the noise measured without a model; final is plain where
    nothing was added.
    """

    trial: Trial
    time: np.ndarray
    phase: np.ndarray
    observed: np.ndarray
    floor: np.ndarray
    plain: Band
    final: Band


def curves(diagnosis: Diagnosis, draws: int = 100, seed: int = 0) -> list[Curve]:
    """Each test by the plain and by the last model of a diagnosis."""
    work = diagnosis.work
    samples = work.samples
    rng = np.random.default_rng(seed)
    steps = work.path.steps
    plain = _bands(diagnosis, steps[0], draws, rng)
    final = _bands(diagnosis, steps[-1], draws, rng) if len(steps) > 1 else plain
    weight = np.asarray(samples.record.blocks.weight)
    floor = np.hypot(work.experiment.floor.white * weight, work.experiment.floor.ou)
    return [
        Curve(
            trial,
            trial.test.time[rows],
            samples.phases(k),
            trial.test.force[rows],
            floor[k, : rows.size],
            plain[k],
            final[k],
        )
        for k, (trial, rows) in enumerate(zip(samples.trials, samples.rows, strict=True))
    ]


def _bands(diagnosis: Diagnosis, step: Step, draws: int, rng: np.random.Generator) -> list[Band]:
    """One model's force at every test's samples; the first constants are the best ones."""
    work, form = diagnosis.work, step.form
    places = _draw(step, draws, rng)
    constants = _constants(work.ensemble, step.point, places)
    force = (
        work.samples.predict(constants)
        if form is None
        else form.predict(work.samples, constants, form.split(places)[1])
    )
    sd = _noise(work, constants)
    found = []
    for k, rows in enumerate(work.samples.rows):
        here = np.stack([forces[k] for forces in force])
        low, high = _quantiles(here[1:], sd[1:, k, : rows.size])
        found.append(Band(here[0], low, high))
    return found


def _draw(step: Step, draws: int, rng: np.random.Generator) -> np.ndarray:
    """(1 + draws, D) the optimum and normal draws about it."""
    point = step.point
    free = point.subset.theta if step.form is None else step.form.free
    thetas = np.tile(point.theta, (1 + draws, 1))
    thetas[1:, free] = rng.multivariate_normal(
        point.theta[free], point.covariance, draws, check_valid="ignore", method="eigh"
    )
    return thetas


def _constants(ensemble: Ensemble, point: Point, places: np.ndarray) -> np.ndarray:
    """(W, P) constants of places (W, D): drawn in theta, each is where its prior allows it."""
    posterior = ensemble.posterior
    found = [
        point.subset.nulled(np.asarray(prior_terms(posterior, theta).constants))
        for theta in places[1:, : posterior.size]
    ]
    return np.stack([point.constants, *found])


def _noise(work: Work, constants: np.ndarray) -> np.ndarray:
    """(W, T, B) sd of the noise of constants (W, P) at the samples."""
    noise, weight = work.ensemble.posterior.noise, work.samples.record.blocks.weight
    kind = type(noise)
    own = constants[:, -len(noise.units) :]
    sds = jax.vmap(lambda x: kind(*x).sample_sd(weight))(own)
    return np.broadcast_to(np.asarray(sds), (len(constants), *weight.shape))


def _quantiles(force: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """5 % and 95 % (n,) of draws (W, n), each with normal noise at even quantiles."""
    finite = np.isfinite(force).all(axis=1)
    readings = force[finite, None] + sd[finite, None] * _NOISES[:, None]
    low, high = np.quantile(readings.reshape(-1, force.shape[1]), _BAND, axis=0)
    return low, high
