"""Force curves of a diagnosis' first and last model, with bands that hold 90 % of samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from qlvbayes.diagnosis.telling.verdict import Diagnosis
from qlvbayes.diagnosis.telling.work import Work
from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.motion.experiment import Trial

Array = NDArray[np.float64]

_BAND = (0.05, 0.95)
_NOISES = ndtri((np.arange(20) + 0.5) / 20.0)  # noise of each draw, at even quantiles


@dataclass(frozen=True, eq=False)
class Band:
    """Force of one model at one test's samples (n,).

    mean: at the constants of highest density; low, high: 5 % and 95 % quantiles of single readings,
    from Laplace's approximation of the constants, the discrepancy and the noise floor.
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
    plain = _bands(work, work.path[0], draws, rng)
    final = _bands(work, work.told, draws, rng) if len(work.path) > 1 else plain
    return [
        Curve(
            trial,
            trial.test.time[rows],
            samples.phases(k),
            trial.test.force[rows],
            samples.floor(k),
            plain[k],
            final[k],
        )
        for k, (trial, rows) in enumerate(zip(samples.trials, samples.rows, strict=True))
    ]


def _bands(work: Work, found: Weighed, draws: int, rng: np.random.Generator) -> list[Band]:
    """One hypothesis's force at every test's samples."""
    own, size = found.point.own, found.mode.size
    thetas = rng.multivariate_normal(
        found.point.theta, found.evidence.covariance, draws, check_valid="ignore", method="eigh"
    )
    thetas = np.concatenate([found.point.theta[None], own.within(thetas)])
    forces = work.samples.predict(found.hypothesis, own.constants(thetas))
    bands = []
    for k, force in enumerate(forces):
        sd = np.hypot(work.samples.floor(k), size)
        low, high = _quantiles(force[1:], sd)
        bands.append(Band(force[0], low, high))
    return bands


def _quantiles(force: Array, sd: Array) -> tuple[Array, Array]:
    """5 % and 95 % (n,) of draws (W, n), each with normal noise of sd (n,) at even quantiles."""
    finite = np.isfinite(force).all(axis=1)
    readings = force[finite, None] + sd * _NOISES[:, None]
    low, high = np.quantile(readings.reshape(-1, force.shape[1]), _BAND, axis=0)
    return low, high
