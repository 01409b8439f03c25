"""Check where a model fails, test by test and phase by phase, against the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from scipy.stats import chi2

from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.arrays import finite_or_none
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.phases import KINDS, phase_index
from qlvbayes.motion.specimen import pull_notices

FALSE_ALARMS = 0.01  # probability that any cell of a right model is called failing


class Cell(
    Part,
    frozen=True,
    rename={"rate": "rate_mm_s", "rmse": "rmse_N", "bias": "bias_N", "limit": "limit_N"},
):
    """Errors of a model in one kind of phase of one test."""

    test: str
    role: str
    rate: float | None  # None where the test has none
    phase: str
    n: int  # number of samples
    # rmse, bias: root mean square and mean of observed minus predicted mean (N)
    rmse: float
    bias: float
    coverage90: float  # share of samples within the 90 % predictive interval
    # probability of an rmse at least as large if the model were right, from posterior draws plus
    # the noise floor
    p_value: float | None = None
    # whether structure beyond noise is left (1 % false alarms over all cells of the pad)
    fails: bool = False
    # rmse (N) beyond which the cell fails; large in short phases, which noise moves as a whole
    limit: float | None = None


class Cycle(Part, frozen=True, rename={"rmse": "rmse_N", "bias": "bias_N"}):
    """Errors in one phase of a test that has several of its kind, such as the loading of a cycle.

    number: counts from 1 in order of time; rmse, bias: as in `Cell` (N).
    """

    test: str
    phase: str
    number: int
    n: int
    rmse: float
    bias: float


class CheckResult(Result, frozen=True, kw_only=True, rename={"noise": "noise_N"}):
    """Errors of one pad's model by test and phase, against the noise floor: ``check.json``.

    Forces are in the unit of ``units.force``, N by default.

    pad: Name of the pad; effects: Names of the model's effects; units: Units of displacement and
    force; noise: Standard deviation of one reading by the noise floor (N), measured without the
    model; cells: Errors in each kind of phase of each test that has samples; at least one; cycles:
    Errors of each single phase whose kind occurs several times in its test, as in cyclic tests;
    notices: Sentences on the measurements and their noise; false_alarms: Probability that any cell
    of a correct model is called failing.
    """

    pad: str
    effects: tuple[str, ...] = ()
    units: UnitSystem = PAD
    noise: float
    cells: Annotated[tuple[Cell, ...], msgspec.Meta(min_length=1)]
    cycles: tuple[Cycle, ...] = ()
    notices: tuple[str, ...] = ()
    false_alarms: float = FALSE_ALARMS

    @property
    def failing(self) -> list[Cell]:
        """Return the cells in which structure beyond noise is left."""
        return [cell for cell in self.cells if cell.fails]

    @property
    def worst(self) -> Cell | None:
        """Return the failing cell with the largest error; None where no cell fails."""
        return max(self.failing, key=lambda cell: cell.rmse, default=None)


def check(
    pad: str,
    noise: float,
    predictions: Sequence[Prediction],
    effects: Sequence[str] = (),
    *,
    units: UnitSystem = PAD,
    notices: Sequence[str] = (),
) -> CheckResult:
    """Compare predictions with measured forces, given the sd of the noise floor (N)."""
    keys = [
        (prediction, kind)
        for prediction in predictions
        for kind in KINDS
        if np.any(prediction.phase == kind)
    ]
    return CheckResult(
        pad=pad,
        effects=tuple(effects),
        units=units,
        noise=noise,
        cells=tuple(_cell(*key, FALSE_ALARMS / len(keys)) for key in keys),
        cycles=tuple(cycle for prediction in predictions for cycle in _cycles(prediction)),
        notices=tuple(notices),
    )


def check_experiment(
    experiment: Experiment, choices: Choices, predictions: Sequence[Prediction]
) -> CheckResult:
    """Return `check` with all that is known of the pad, and notices on its tests."""
    bonded, effects = choices.bonded, choices.effects
    pull = pull_notices(experiment, bonded=bonded, effects=effects)
    noise_notices = [f"pad {experiment.pad}: {text}" for text in experiment.floor.notices]
    return check(
        experiment.pad,
        experiment.floor.total,
        predictions,
        effects,
        units=experiment.units,
        notices=(*experiment.notices, *pull, *noise_notices),
    )


def _cell(prediction: Prediction, kind: str, level: float) -> Cell:
    """Return one cell, which fails if its p-value is below ``level``."""
    selected = prediction.phase == kind
    residual = prediction.residual[selected]
    inside = (prediction.observed >= prediction.low) & (prediction.observed <= prediction.high)
    trial = prediction.trial
    rmse = _rmse(residual)
    p_value, limit = _judged(rmse, prediction, selected, level)
    return Cell(
        test=trial.name,
        role=trial.role,
        rate=finite_or_none(trial.rate),
        phase=kind,
        n=int(selected.sum()),
        rmse=rmse,
        bias=float(residual.mean()),
        coverage90=float(inside[selected].mean()),
        p_value=p_value,
        fails=p_value < level,
        limit=limit,
    )


def _cycles(prediction: Prediction) -> list[Cycle]:
    """Return every phase separately, of those kinds that the test has several of."""
    phases = prediction.trial.phases
    phase_of_sample = phase_index(phases, prediction.time)
    cycles = []
    for kind in KINDS:
        indices = [k for k, phase in enumerate(phases) if phase.kind == kind]
        for number, k in enumerate(indices, start=1):
            residual = prediction.residual[phase_of_sample == k]
            if len(indices) > 1 and residual.size:
                name, bias = prediction.trial.name, float(residual.mean())
                cycles.append(Cycle(name, kind, number, residual.size, _rmse(residual), bias))
    return cycles


def _rmse(residual: np.ndarray) -> float:
    """Return the root mean square of residuals."""
    return float(np.sqrt(np.mean(residual**2)))


def _judged(
    rmse: float, prediction: Prediction, selected: np.ndarray, level: float
) -> tuple[float, float]:
    """Return the probability of a larger error by noise, and the error of probability ``level``.

    The mean square is a sum of chi-squares, of only a few where noise is correlated over much of
    the cell. A chi-square with the same mean, variance and skewness has the same upper tail
    (Pearson's approximation; Imhof 1961, doi:10.1093/biomet/48.3-4.419), here of few draws.
    """
    error = (prediction.forces - prediction.mean + prediction.floor)[:, selected]
    mean, variance, third = _cumulants(error)
    if variance <= 0.0:
        return float(rmse**2 <= mean), float(np.sqrt(mean))
    freedom = 8.0 * variance**3 / max(third, 1e-3 * variance**1.5) ** 2
    scale = np.sqrt(variance / (2.0 * freedom))
    limit = mean + scale * (chi2.isf(level, freedom) - freedom)
    p_value = chi2.sf(freedom + (rmse**2 - mean) / scale, freedom)
    return float(p_value), float(np.sqrt(max(limit, 0.0)))


def _cumulants(error: np.ndarray) -> tuple[float, float, float]:
    """Return the first three cumulants of the mean square of a normal error, given its draws."""
    draws, size = error.shape
    products = error @ error.T / size
    mean = float(np.trace(products)) / draws
    np.fill_diagonal(products, 0.0)
    twice = products @ products
    second = np.trace(twice) / (draws * (draws - 1))
    third = np.sum(twice * products) / (draws * (draws - 1) * (draws - 2))
    return mean, 2.0 * float(second), 8.0 * float(third)
