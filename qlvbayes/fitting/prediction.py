"""Predict tests from a posterior, sample by sample, with the errors of a fit at any samples.

These are noise, and, given the fitted tests, the discrepancy and the error of each contact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np

from qlvbayes.fitting.marginal_likelihood import known_floor, with_zero_errors
from qlvbayes.fitting.posterior import Predictor
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import Features, Locations
from qlvbayes.io.arrays import Array
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import Floor
from qlvbayes.model.parameters import filled
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.phases import phase_index
from qlvbayes.motion.record import Blocks, Record, batch, held
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
    constants: Mapping[str, np.ndarray],
    trials: Sequence[Trial],
    *,
    seed: int = 0,
) -> list[Prediction]:
    """Predict some trials from posterior draws (draws,) of each constant."""
    experiment = replace(experiment, rested=choices.rested)
    chosen = [_rows(trial) for trial in trials]
    parts = zip(trials, chosen, strict=True)
    record = batch([experiment.reduced(trial, rows) for trial, rows in parts])
    predictor = Predictor.from_model(*choices.build(experiment.scales), record)
    rng = np.random.default_rng(seed)
    every = np.stack([np.ravel(constants[name]) for name in predictor.names], axis=-1)
    matrix = every[rng.integers(0, len(every), DRAWS)]
    forces = predictor.forces(matrix)
    noise = np.zeros(forces.shape)
    if isinstance(predictor.noise, Floor):
        known = replace(experiment, floor=known_floor(experiment.floor, predictor.noise))
        middle = predictor.parameters.model_at(matrix.mean(axis=0))
        predictor = predictor.over(with_zero_errors(predictor.record, trials, middle))
        fitted = experiment.with_role("fit")
        of_fit = with_zero_errors(experiment.record(fitted), fitted, middle)
        samples = predictor.record.blocks
        inside = np.asarray(samples.real)
        expected = replace(samples, force=forces.mean(axis=0))
        places = Locations.from_blocks(known, trials, expected)
        contacts = Contacts.from_trials(trials, fitted)
        noise[:, inside], zeros = errors_given_fit(
            known, predictor.over(of_fit), fitted, matrix, places, contacts, rng
        )
        moved, rest = contacts.moved(predictor.record, zeros)
        forces, predictor = forces + moved, predictor.over(rest)
    noise += _noise(predictor, matrix, rng)
    blocks, floors = predictor.record.blocks, experiment.floor.draws(DRAWS)
    tests = [jax.tree.map(lambda x, k=k: np.asarray(x[k]), blocks) for k in range(len(trials))]
    floor = [realisations(floors, test, rng) for test in tests]
    predictions = []
    for k, (trial, rows) in enumerate(zip(trials, chosen, strict=True)):
        time, force = trial.test.time[rows], forces[:, k, : rows.size]
        low, high = np.quantile(force + noise[:, k, : rows.size], [0.05, 0.95], axis=0)
        measured = time, trial.phase_of(time), trial.test.force[rows]
        known_draws = force, floor[k][:, : rows.size]
        predictions.append(
            Prediction(trial, *measured, force.mean(axis=0), low, high, *known_draws)
        )
    return predictions


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


def representative_rows(trial: Trial) -> np.ndarray:
    """Return the indices of samples that represent a trial."""
    rows = _rows(trial)
    return rows[clear_of_kinks(trial.test.time, trial.trajectory, trial.phases)[rows]]


def _noise(predictor: Predictor, matrix: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return noise (DRAWS, T, B) of single samples, each draw with its own sd."""
    samples, count = predictor.record.blocks, len(predictor.noise.units)
    noise = filled(predictor.noise, matrix.T[-count:, :, None, None])
    shape = (len(matrix), *samples.weight.shape)
    errors: np.ndarray = noise.sample_sd(samples) * rng.standard_normal(shape)
    return _with_zeros(errors, samples, rng)


def _with_zeros(errors: np.ndarray, samples: Blocks, rng: np.random.Generator) -> np.ndarray:
    """Return errors (..., B) in N with those of the contact and the tare of each test added."""
    for zero in (np.asarray(samples.contact), np.asarray(samples.tare)):
        if zero.any():
            errors = errors + zero * rng.standard_normal((*errors.shape[:-1], 1))
    return errors


@dataclass(frozen=True)
class Contacts:
    """The C measured contacts of fitted tests: of a stage, or of one test alone.

    ``predicted`` (T,) and ``fitted`` (T',) name the contact of each test, C where it has another.
    """

    count: int
    predicted: np.ndarray
    fitted: np.ndarray

    @classmethod
    def from_trials(cls, trials: Sequence[Trial], fitted: Sequence[Trial]) -> Contacts:
        """Return the contacts of fitted tests, and which of them each test has."""
        names = list(dict.fromkeys(map(_contact_name, fitted)))

        def number(trial: Trial) -> int:
            name = _contact_name(trial)
            return names.index(name) if name in names else len(names)

        return cls(
            len(names), *(np.array([number(one) for one in some]) for some in (trials, fitted))
        )

    def changes(self, blocks: Blocks) -> np.ndarray:
        """Return what one standard error of each contact changes of the fitted tests (C, T', B)."""
        own = (self.fitted == np.arange(self.count)[:, None])[..., None]
        return np.where(own, np.asarray(blocks.contact), 0.0)

    def moved(self, record: Record, zeros: np.ndarray) -> tuple[np.ndarray, Record]:
        """Return the change (R, T, B) in N by errors (R, C), and the record without them."""
        blocks, known = record.blocks, (self.predicted < self.count)[:, None]
        own = np.where(known, np.asarray(blocks.contact), 0.0)
        every = np.concatenate([zeros, np.zeros((len(zeros), 1))], axis=1)
        rest = [np.where(known, 0.0, np.asarray(one)) for one in (blocks.zero, blocks.stage)]
        left = replace(blocks, zero=held(rest[0]), stage=held(rest[1]))
        return every[:, self.predicted, None] * own, replace(record, blocks=left)


def _contact_name(trial: Trial) -> str:
    return f"stage {trial.test.contact_stage}" if trial.test.contact_stage else trial.name


def errors_given_fit(
    experiment: Experiment,
    predictor: Predictor,
    fitted: Sequence[Trial],
    constants: Array,
    locations: Locations,
    contacts: Contacts,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    r"""Return draws of the discrepancy (R, N) in N, and of C contacts' errors (R, C) in their sds.

    Each row of constants has draws of its own. Given a discrepancy of size s and a floor of scale
    phi, the coefficients w of its smooth functions are normal given the fitted tests' whitened
    residuals r (`discrepancy.Discrepancy.weights`, at the size s / phi). At a sample x the features
    phi(x) leave out a part of the smooth functions (namely the function of the sample's own test,
    if that was not fitted). Together with the rough part it has the variance

    .. math:: s^2 \left(g^2 - \phi(x)^T \phi(x) + \rho\right).

    The errors e of the contacts, of whitened changes U (C, n), are normal given what w leaves,

    .. math:: e \sim N\left(U (r - B^T w),\ \phi^2 (1 - U U^T)\right).

    Realisations of the noise floor at single readings are drawn separately.
    """
    sizes, scales = constants[:, -1], constants[:, -2]
    blocks = predictor.record.blocks
    discrepancy = Discrepancy.from_blocks(experiment, fitted, blocks)
    left = discrepancy.whitener(predictor.residuals(constants))
    draws = np.zeros((len(constants), locations.size.size))
    rows = np.flatnonzero(sizes > 0.0)
    features = Features.from_locations(Locations.from_blocks(experiment, fitted, blocks))(locations)
    ratios = sizes / scales
    left_out = np.maximum(locations.size**2 - np.sum(features**2, axis=0), 0.0) + discrepancy.rough
    for ratio in np.unique(ratios[rows]):
        same = rows[ratios[rows] == ratio]
        mean, root = discrepancy.weights(left[same], float(ratio))
        coefficients = mean + scales[same, None] * (rng.standard_normal(mean.shape) @ root)
        noise = rng.standard_normal((len(coefficients), left_out.size)) * np.sqrt(left_out)
        draws[same] = coefficients @ features + sizes[same, None] * noise
        left[same] -= coefficients @ discrepancy.shapes
    changes = discrepancy.whitener(contacts.changes(blocks))
    open_part = np.linalg.cholesky(np.eye(contacts.count) - changes @ changes.T)
    spread = scales[:, None] * (rng.standard_normal((len(constants), contacts.count)) @ open_part.T)
    return draws, left @ changes.T + spread


def realisations(
    floors: Sequence[NoiseFloor], samples: Blocks, rng: np.random.Generator
) -> np.ndarray:
    """Return one realisation of each of F noise floors at n single readings, (F, n) in N."""
    time, weight, scale = (np.asarray(x) for x in (samples.first, samples.weight, samples.scale))
    extra, timing = np.asarray(samples.extra), np.asarray(samples.timing)
    white, ou, tau = (
        np.array([getattr(floor, name) for floor in floors])[:, None]
        for name in ("white", "ou", "tau")
    )
    shape = (len(floors), time.size)
    errors = scale * (
        white * weight * rng.standard_normal(shape) + ou * _walk(time, tau[:, 0], rng)
    )
    errors += extra * rng.standard_normal((len(floors), 1))
    errors += timing * rng.standard_normal(shape)
    return _with_zeros(np.asarray(errors), samples, rng)


def _walk(time: np.ndarray, tau: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return unit Ornstein-Uhlenbeck processes (D, n) of correlation times tau (D,)."""
    memory = np.exp(-np.diff(time) / tau[:, None])
    kicks = rng.standard_normal((tau.size, time.size))
    kicks[:, 1:] *= np.sqrt(1.0 - memory**2)
    for k in range(1, time.size):
        kicks[:, k] += memory[:, k - 1] * kicks[:, k - 1]
    return kicks
