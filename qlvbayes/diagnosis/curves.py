"""Force curves of a diagnosis' first and last model, with bands that hold 90 % of samples."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import ndtri

from qlvbayes.diagnosis.search import Step
from qlvbayes.diagnosis.verdict import Diagnosis
from qlvbayes.experiment import Trial
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.linearised import forces as forces_of
from qlvbayes.inference.linearised import prior_terms
from qlvbayes.inference.subset import Ensemble
from qlvbayes.posterior import Posterior
from qlvbayes.records.record import Record

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
    weight = np.asarray(samples.posterior.record.blocks.weight)
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
    record = work.samples.posterior.record
    places = _draw(step, draws, rng)
    constants = _constants(work.ensemble, step.point, places)
    force, sd = _forces(work.ensemble, constants, record)
    base = None if form is None else form.base(work.samples, constants)
    found = []
    for k, rows in enumerate(work.samples.rows):
        here = force[:, k, : rows.size]
        if form is not None and base is not None:
            trial, less = work.samples.trials[k], np.stack([forces[k] for forces in base])
            coefficients = form.split(places)[1]
            here = less + (here - less) * form.trial_factor(
                trial, trial.test.time[rows], coefficients
            )
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
        point.subset.nulled(np.asarray(prior_terms(posterior, jnp.asarray(theta)).constants))
        for theta in places[1:, : posterior.size]
    ]
    return np.stack([point.constants, *found])


def _forces(
    ensemble: Ensemble, constants: np.ndarray, record: Record
) -> tuple[np.ndarray, np.ndarray]:
    """Force and sd of the noise (W, T, B) of constants (W, P), by the cheapest part that can."""
    part = ensemble.part(constants[0], np.zeros((1, constants.shape[1])))
    posterior = Posterior(part.posterior.model, part.posterior.noise, record)
    own = jnp.asarray(constants[:, part.constants])
    weight = record.blocks.weight
    sds = jax.vmap(lambda x: posterior.with_constants(x)[1].sample_sd(weight))(own)
    found = np.asarray(forces_of(posterior, own))
    return found, np.broadcast_to(np.asarray(sds), found.shape)


def _quantiles(force: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """5 % and 95 % (n,) of draws (W, n), each with normal noise at even quantiles."""
    finite = np.isfinite(force).all(axis=1)
    readings = force[finite, None] + sd[finite, None] * _NOISES[:, None]
    low, high = np.quantile(readings.reshape(-1, force.shape[1]), _BAND, axis=0)
    return low, high
