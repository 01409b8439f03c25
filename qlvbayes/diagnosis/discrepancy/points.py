"""The points of a discrepancy: residual block means of every test, and the inputs of any sample."""

from __future__ import annotations

import jax
import numpy as np

from qlvbayes.diagnosis.discrepancy.process import Inputs, Residuals
from qlvbayes.diagnosis.verdict import Work
from qlvbayes.experiment import Experiment, Trial
from qlvbayes.inference.floor_covariance import floor_covariance
from qlvbayes.inference.gaussnewton import Point, predict_along
from qlvbayes.kinematics.phases import KINDS, phase_index

_MOST = 300  # points that the process is fitted to
_UNKNOWN = 1e6  # variance that takes a point out, over the residuals' mean square
_LEAST = 0.5  # of the discrepancy's size where there is no force


def inputs_at(
    experiment: Experiment, trial: Trial, k: int, time: np.ndarray, force: np.ndarray
) -> Inputs:
    """Inputs at some times of trial k, where the model's force is ``force``."""
    scales = experiment.scales
    starts = np.array([phase.start for phase in trial.phases])
    place = phase_index(trial.phases, time)
    kinds = np.array([KINDS.index(phase.kind) for phase in trial.phases])
    share = np.minimum(np.abs(force) / scales.force, 1.0)
    return Inputs(
        log_time=np.log(np.maximum(time - starts[place], 0.0) + scales.shortest),
        depth=trial.trajectory.displacement(time) / scales.depth,
        log_rate=np.full(time.shape, np.log(max(trial.rate, 1e-9))),
        size=_LEAST + (1.0 - _LEAST) * share,
        phase=kinds[place].astype(float),
        test=np.full(time.shape, float(k)),
    )


def residuals_of(work: Work, point: Point) -> Residuals:
    """Block means of every test, evenly thinned and filled up to one size."""
    blocks = jax.tree.map(np.asarray, work.ensemble.posterior.record.blocks)
    still = np.zeros((1, point.constants.size))
    predicted, _ = predict_along(work.ensemble, point.constants, still)
    inputs = [np.append(np.zeros((_MOST, 5)), np.full((_MOST, 1), -1.0), axis=1)]
    residual, noise, at = np.zeros(_MOST), np.eye(_MOST), 0
    for k, trial in enumerate(work.experiment.trials):
        rows = _thinned(np.flatnonzero(blocks.real[k]), _MOST // len(work.experiment.trials))
        own = jax.tree.map(lambda x, k=k, rows=rows: x[k, rows], blocks)
        force = predicted[k, rows]
        here = slice(at, at + rows.size)
        residual[here] = own.force - force
        noise[here, here] = floor_covariance(work.experiment, own)
        middle = 0.5 * (own.first + own.last)
        inputs.insert(-1, np.stack(inputs_at(work.experiment, trial, k, middle, force), axis=1))
        at += rows.size
    filler = np.arange(_MOST) >= at
    noise[filler, filler] = _UNKNOWN * np.mean(residual**2)
    return Residuals(Inputs(*np.concatenate(inputs)[:_MOST].T), residual, noise)


def without_test(residuals: Residuals, k: int) -> Residuals:
    """The same points, nothing known of those of test k."""
    unknown = np.asarray(residuals.inputs.test) == k
    noise = np.array(residuals.noise)
    noise[unknown] = 0.0
    noise[:, unknown] = 0.0
    noise[unknown, unknown] = _UNKNOWN * np.mean(residuals.residual**2)
    return residuals._replace(noise=noise, residual=np.where(unknown, 0.0, residuals.residual))


def of_tests(residuals: Residuals) -> np.ndarray:
    """Which points (N,) are of a test; the others only fill up."""
    return np.asarray(residuals.inputs.test) >= 0


def _thinned(rows: np.ndarray, most: int) -> np.ndarray:
    """At most so many, evenly taken."""
    return rows[np.unique(np.linspace(0, rows.size - 1, min(most, rows.size)).astype(int))]
