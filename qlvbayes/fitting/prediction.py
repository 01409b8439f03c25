"""Predict tests from a posterior, sample by sample, with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np

from qlvbayes.fitting.drawn_errors import discrepancy_draws, realisations
from qlvbayes.fitting.marginal_likelihood import known_floor, with_zero_errors
from qlvbayes.fitting.posterior import Predictor
from qlvbayes.inference.errors.features import Locations
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import Floor
from qlvbayes.model.parameters import filled
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import phase_index
from qlvbayes.motion.record import Record, batch
from qlvbayes.motion.reduction import clear_of_kinks

DRAWS = 400
_ROWS = 300  # largest number of samples in a phase, evenly spread in the logarithm of time


@dataclass(frozen=True, eq=False)
class Prediction:
    """The n samples of one test, and their predictions.

    trial: The test; time, phase: Time (s) and kind of phase of each sample; observed: Measured
    force; mean: Posterior mean of the model's force; low, high: Ends of the 90 % predictive
    interval, with noise and with the discrepancy that the fit implies. The mean may therefore lie
    outside it; forces: The model's force (draws, n) for each posterior draw; floor: Realisations
    (draws, n) of the noise floor that was measured without the model, each with its own draw of
    what the dwells leave open.
    """

    trial: Trial
    time: np.ndarray
    phase: np.ndarray
    observed: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    forces: np.ndarray
    floor: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Return the observed force minus the predicted mean (n,)."""
        return self.observed - self.mean


def predict(
    experiment: Experiment,
    choices: Choices,
    constants: dict[str, np.ndarray],
    trials: Sequence[Trial],
    *,
    seed: int = 0,
) -> list[Prediction]:
    """Predict some trials from posterior draws (draws,) of each constant."""
    experiment = replace(experiment, rested=choices.rested)
    chosen = [_rows(trial) for trial in trials]
    predictor = _sample_by_sample(experiment, choices, trials, chosen)
    rng = np.random.default_rng(seed)
    matrix = _drawn(constants, predictor.names, rng)
    forces = predictor.forces(matrix)
    if isinstance(predictor.noise, Floor):
        middle = predictor.parameters.model_at(matrix.mean(axis=0))
        predictor = predictor.over(with_zero_errors(predictor.record, trials, middle))
    noise = _noise(predictor, matrix, rng)
    floor = _floor_draws(experiment, predictor.record, rng)
    if isinstance(predictor.noise, Floor):
        known = replace(experiment, floor=known_floor(experiment.floor, predictor.noise))
        noise += _discrepancy(known, predictor, matrix, trials, chosen, forces.mean(axis=0), rng)
    return [
        _prediction(trial, rows, forces[:, k], noise[:, k], floor[:, k])
        for k, (trial, rows) in enumerate(zip(trials, chosen, strict=True))
    ]


def _rows(trial: Trial) -> np.ndarray:
    """Return the indices of samples to predict: all of a short phase, some of a long one."""
    phase = phase_index(trial.phases, trial.test.time)
    picked = []
    for k in range(len(trial.phases)):
        inside = np.flatnonzero(phase == k)
        if inside.size > _ROWS:
            positions = np.geomspace(1.0, inside.size, _ROWS).astype(int) - 1
            inside = inside[np.unique(np.concatenate([positions, [inside.size - 1]]))]
        picked.append(inside)
    return np.unique(np.concatenate(picked))


def _sample_by_sample(
    experiment: Experiment, choices: Choices, trials: Sequence[Trial], rows: list[np.ndarray]
) -> Predictor:
    """Return the model over a record of which each sample is a block of its own."""
    model, noise = choices.build(experiment.scales)
    records = [
        single_samples(experiment, trial, chosen)
        for trial, chosen in zip(trials, rows, strict=True)
    ]
    return Predictor.from_model(model, noise, batch(records))


def representative_rows(trial: Trial) -> np.ndarray:
    """Return the indices of samples that represent a trial."""
    rows = _rows(trial)
    return rows[clear_of_kinks(trial.test.time, trial.trajectory, trial.phases)[rows]]


def single_samples(experiment: Experiment, trial: Trial, rows: np.ndarray) -> Record:
    """Return the record of some samples of a trial, each its own block."""
    test = trial.test
    thinned = replace(
        test,
        time=test.time[rows],
        displacement=test.displacement[rows],
        force=test.force[rows],
        force_sd=None if test.force_sd is None else test.force_sd[rows],
    )
    return experiment.reduced(trial, thinned)


def _drawn(
    constants: dict[str, np.ndarray], order: list[str], rng: np.random.Generator
) -> np.ndarray:
    """Return draws (DRAWS, P) of the constants in the posterior's order."""
    matrix = np.stack([np.ravel(constants[name]) for name in order], axis=-1)
    return matrix[rng.integers(0, len(matrix), DRAWS)]


def _noise(predictor: Predictor, matrix: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return noise (DRAWS, T, B) of single samples, each draw with its own sd."""
    samples, count = predictor.record.blocks, len(predictor.noise.units)
    noise = filled(predictor.noise, matrix.T[-count:, :, None, None])
    shape = (len(matrix), *samples.weight.shape)
    errors: np.ndarray = noise.sample_sd(samples) * rng.standard_normal(shape)
    if samples.contact.any():
        errors += samples.contact * rng.standard_normal((*shape[:2], 1))
    return errors


def _discrepancy(
    experiment: Experiment,
    predictor: Predictor,
    matrix: np.ndarray,
    trials: Sequence[Trial],
    chosen: Sequence[np.ndarray],
    forces: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return draws (DRAWS, T, B) of the discrepancy at the samples, where the force is (T, B)."""
    names = [trial.name for trial in experiment.trials]
    locations = Locations.joined(
        [
            Locations.from_trial(
                experiment,
                trial,
                names.index(trial.name),
                trial.test.time[rows],
                forces[k, : rows.size],
            )
            for k, (trial, rows) in enumerate(zip(trials, chosen, strict=True))
        ]
    )
    fitted = experiment.with_role("fit")
    of_fit = predictor.over(experiment.record(fitted))
    drawn = np.zeros((len(matrix), *forces.shape))
    inside = np.zeros(forces.shape, dtype=bool)
    for k, rows in enumerate(chosen):
        inside[k, : rows.size] = True
    drawn[:, inside] = discrepancy_draws(experiment, of_fit, fitted, matrix, locations, rng)
    return drawn


def _floor_draws(experiment: Experiment, record: Record, rng: np.random.Generator) -> np.ndarray:
    """Return realisations (DRAWS, T, B) of the floor, each with its own draw given the dwells."""
    blocks = record.blocks
    floors = experiment.floor.draws(DRAWS)
    tests = [
        jax.tree.map(lambda x, k=k: np.asarray(x[k]), blocks) for k in range(len(blocks.force))
    ]
    return np.stack([realisations(floors, test, rng) for test in tests], axis=1)


def _prediction(
    trial: Trial, rows: np.ndarray, forces: np.ndarray, noise: np.ndarray, floor: np.ndarray
) -> Prediction:
    """Return the prediction of one trial."""
    count = rows.size
    forces, noise, floor = forces[:, :count], noise[:, :count], floor[:, :count]
    low, high = np.quantile(forces + noise, [0.05, 0.95], axis=0)
    time = trial.test.time[rows]
    return Prediction(
        trial,
        time,
        trial.phase_of(time),
        trial.test.force[rows],
        forces.mean(axis=0),
        low,
        high,
        forces,
        floor,
    )
