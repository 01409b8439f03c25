"""Check where a model fails, test by test and phase by phase, against the noise floor.

A saved fit is compared with a pad's tests, and its curves are kept to plot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
from scipy.stats import chi2

from qlvbayes.fitting.prediction import Prediction, predict
from qlvbayes.fitting.results import Saved
from qlvbayes.io.arrays import finite_or_none
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import factors, has_noise
from qlvbayes.motion.clean import UnusedReadings as Unused
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.phases import KINDS, phase_index
from qlvbayes.motion.specimen import pull_notices

_DIGITS = 5  # significant digits of curves
FALSE_ALARMS = 0.01  # probability that any cell of a right model is called failing
_FORCES = ("noise", "rmse", "bias", "limit", "force", "observed", "mean", "low", "high")
KEYS = {name: f"{name}_N" for name in _FORCES}
KEYS |= {"rate": "rate_mm_s", "displacement": "displacement_mm"}
KEYS |= {name: f"{name}_s" for name in ("start", "stop", "time")}
"""Keys of files that say a quantity's unit, by the attribute's name."""


class Cell(Part, frozen=True, rename=KEYS):
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
    # sd (N) of the noise of these readings, where the file states an sd of each
    noise: float | None = None


def over_floor(cell: Any, floor: float) -> float:
    """Return the error of a phase over the noise of its readings, by default a floor."""
    noise = floor if cell.noise is None else cell.noise
    return float(cell.rmse / noise) if noise > 0.0 else inf


class Cycle(Part, frozen=True, rename=KEYS):
    """Errors in one phase of a test that has several of its kind, such as the loading of a cycle.

    number: counts from 1 in order of time; rmse, bias: as in `Cell` (N).
    """

    test: str
    phase: str
    number: int
    n: int
    rmse: float
    bias: float


class CheckResult(Result, frozen=True, kw_only=True, rename=KEYS):
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
    every = [(one, kind) for one in predictions for kind in KINDS if np.any(one.phase == kind)]
    return CheckResult(
        pad=pad, effects=tuple(effects), units=units, noise=noise,
        cells=tuple(_cell(*each, FALSE_ALARMS / len(every)) for each in every),
        cycles=tuple(cycle for prediction in predictions for cycle in _cycles(prediction)),
        notices=tuple(notices),
    )  # fmt: skip


def check_experiment(
    experiment: Experiment, choices: Choices, predictions: Sequence[Prediction]
) -> CheckResult:
    """Return `check` with all that is known of the pad, and notices on its tests."""
    bonded, effects, floor = choices.bonded, choices.effects, experiment.floor
    pull = pull_notices(experiment, bonded=bonded, effects=effects)
    noise = (f"pad {experiment.pad}: {text}" for text in floor.notices)
    notices = (*experiment.notices, *pull, *noise)
    units = experiment.units
    return check(experiment.pad, floor.total, predictions, effects, units=units, notices=notices)


def _cell(prediction: Prediction, kind: str, level: float) -> Cell:
    """Return one cell, which fails if its p-value is below ``level``."""
    selected, trial = prediction.phase == kind, prediction.trial
    residual = prediction.residual[selected]
    inside = (prediction.observed >= prediction.low) & (prediction.observed <= prediction.high)
    p_value, limit = _judged(_rmse(residual), prediction, selected, level)
    return Cell(
        test=trial.name, role=trial.role, rate=finite_or_none(trial.rate), phase=kind,
        n=int(selected.sum()), rmse=_rmse(residual), bias=float(residual.mean()),
        coverage90=float(inside[selected].mean()), p_value=p_value, fails=p_value < level,
        limit=limit,
        noise=None if trial.test.force_sd is None else _rmse(prediction.floor[:, selected]),
    )  # fmt: skip


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
    limit = error_limit((mean, variance, third), level)
    if variance <= 0.0:
        return float(rmse**2 <= mean), limit
    freedom, scale = _gamma(variance, third)
    return float(chi2.sf(freedom + (rmse**2 - mean) / scale, freedom)), limit


def error_limit(cumulants: tuple[float, float, float], level: float) -> float:
    """Return the root mean square error that is exceeded with probability ``level``.

    The three cumulants are those of its square.
    """
    mean, variance, third = cumulants
    if variance <= 0.0:
        return float(np.sqrt(mean))
    freedom, scale = _gamma(variance, third)
    return float(np.sqrt(max(mean + scale * (chi2.isf(level, freedom) - freedom), 0.0)))


def _gamma(variance: float, third: float) -> tuple[float, float]:
    """Return degrees of freedom and scale of the chi-square with this variance and skewness."""
    freedom = 8.0 * variance**3 / max(third, 1e-3 * variance**1.5) ** 2
    return freedom, float(np.sqrt(variance / (2.0 * freedom)))


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


@dataclass(frozen=True, eq=False)
class CheckedPad:
    """The tests of one pad, their predictions, and the comparison by test and phase."""

    experiment: Experiment
    predictions: tuple[Prediction, ...]
    check: CheckResult


def check_pad(saved: Saved, pad: Pad, *, seed: int = 0) -> CheckedPad:
    """Predict all tests of a pad from a saved posterior, and check them."""
    if not has_noise(saved.names):
        remedy = "give draws of noise.white, or also of noise.ou and noise.tau"
        raise InputError(f"the posterior of pad {saved.pad} has no noise", remedy=remedy)
    experiment = saved.choices.prepare(pad, all_tests=saved.all_tests)
    constants = dict(zip(saved.names, saved.curve_draws.T, strict=True))
    scales = factors(saved.choices, constants, saved.units, pad.units)
    constants = {name: scales[name] * draws for name, draws in constants.items()}
    predictions = predict(experiment, saved.choices, constants, experiment.trials, seed=seed)
    check = check_experiment(experiment, saved.choices, predictions)
    return CheckedPad(experiment, tuple(predictions), check)


class PhaseSpan(Part, frozen=True, rename=KEYS):
    """A phase of a test: its kind, and its beginning and end (s)."""

    kind: str
    start: float
    stop: float


class LeftOutReading(Part, frozen=True, rename=KEYS):
    """A reading that was left out: time (s), displacement, force, channel and why."""

    time: float
    displacement: float
    force: float
    channel: str
    # the fault, or ``excluded`` where the user leaves the force out; of a long run of these there
    # are fifty, evenly spaced
    kind: str


class TestCurves(Part, frozen=True, rename=KEYS):
    """The curves of one test, at n samples, in the units of `Curves`.

    time (s), phase (its kind), displacement and observed force; mean: posterior mean of the force;
    low, high: ends of the 90 % predictive interval; left_out: readings that are not among the
    samples.
    """

    test: str
    role: str
    rate: float | None
    phases: tuple[PhaseSpan, ...]
    time: tuple[float, ...]
    phase: tuple[str, ...]
    displacement: tuple[float, ...]
    observed: tuple[float, ...]
    mean: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    left_out: tuple[LeftOutReading, ...] = ()


class Curves(Result, frozen=True, kw_only=True, rename=KEYS):
    """The curves of one pad at representative samples, at most 300 a phase: ``curves.json``."""

    indent: ClassVar[int | None] = None

    pad: str
    effects: tuple[str, ...]
    units: UnitSystem = PAD
    force_unit: str
    force_name: str
    displacement_unit: str
    displacement_name: str
    speed_unit: str
    noise: float
    tests: tuple[TestCurves, ...]


def curves(checked: CheckedPad) -> Curves:
    """Return the curves of a checked pad."""
    units, check = checked.experiment.units, checked.check
    return Curves(
        pad=check.pad, effects=check.effects, units=units, force_unit=units.force,
        force_name=units.force_name, displacement_unit=units.displacement,
        displacement_name=units.displacement_name, speed_unit=units.speed, noise=check.noise,
        tests=tuple(map(_curves_of, checked.predictions)),
    )  # fmt: skip


def _curves_of(one: Prediction) -> TestCurves:
    trial, unused = one.trial, one.trial.left_out
    displacement = np.interp(one.time, trial.test.time, trial.test.displacement)
    lines = (displacement, one.observed, one.mean, one.low, one.high)
    moved, observed, mean, low, high = (tuple(map(_short, line)) for line in lines)
    left_out: tuple[LeftOutReading, ...] = ()
    if unused is not None:
        left_out = tuple(_left_out(unused, k) for k in unused.drawn.tolist())
    return TestCurves(
        trial.name, trial.role, finite_or_none(trial.rate),
        tuple(PhaseSpan(p.kind, _short(p.start), _short(p.stop)) for p in trial.phases),
        tuple(map(_exact, one.time)), tuple(map(str, one.phase)),
        moved, observed, mean, low, high, left_out,
    )  # fmt: skip


def _left_out(unused: Unused, k: int) -> LeftOutReading:
    kind, channel = unused.reason[k].split(" ")[:2]
    values = _exact(unused.time[k]), _short(unused.displacement[k]), _short(unused.force[k])
    return LeftOutReading(*values, "force" if kind == "excluded" else channel, kind)


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _exact(time: float) -> float:
    """Return a time rounded to microseconds, which also resolves times late in a test."""
    return round(float(time), 6)
