"""A saved fit against its data: predictions of every test, where they fail, and their curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from qlvbayes.fitting.prediction import Prediction, predict
from qlvbayes.fitting.residuals import CheckResult, check_experiment
from qlvbayes.fitting.results import Saved
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad
from qlvbayes.io.resultfile import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.model.drawn import factors
from qlvbayes.model.elsewhere import has_noise
from qlvbayes.motion.experiment import Experiment, Trial, prepare

_DIGITS = 5  # significant, of every number


@dataclass(frozen=True, eq=False)
class CheckedPad:
    """The tests of one pad, what was predicted of each, and the cells of test and phase."""

    experiment: Experiment
    predictions: tuple[Prediction, ...]
    check: CheckResult


def check_pad(saved: Saved, pad: Pad, *, seed: int = 0) -> CheckedPad:
    """Predict all tests of ``pad`` from a saved posterior.

    Tests keep the role they had in the fit, so that fitted ones are not taken for predictions.
    Constants in other units than the pad's are converted.
    Raises InputError where the posterior, made elsewhere, has no noise to predict with.
    """
    if not has_noise(saved.names):
        raise InputError(
            f"the posterior of pad {saved.pad} has no noise",
            remedy="give draws of noise.white, or also of noise.ou and noise.tau",
        )
    experiment = prepare(
        pad,
        all_tests=saved.all_tests,
        keep_all_readings=saved.choices.keep_all_readings,
        use=saved.choices.use,
    )
    constants = dict(zip(saved.names, saved.curve_draws.T, strict=True))
    by = factors(saved.choices, constants, saved.units, pad.units)
    constants = {name: by[name] * draws for name, draws in constants.items()}
    predictions = predict(experiment, saved.choices, constants, experiment.trials, seed=seed)
    found = check_experiment(experiment, saved.choices, predictions)
    return CheckedPad(experiment, tuple(predictions), found)


class PhaseSpan(Part, frozen=True, rename={"start": "start_s", "stop": "stop_s"}):
    """A phase of a test: its kind, and from when to when (s)."""

    kind: str
    start: float
    stop: float


class LeftOut(
    Part,
    frozen=True,
    rename={"time": "time_s", "displacement": "displacement_mm", "force": "force_N"},
):
    """A reading that was left out: when, what was read, in which channel it is bad, and how."""

    time: float
    displacement: float
    force: float
    channel: str
    kind: str


class TestCurves(
    Part,
    frozen=True,
    rename={
        "rate": "rate_mm_s",
        "time": "time_s",
        "displacement": "displacement_mm",
        "observed": "observed_N",
        "mean": "mean_N",
        "low": "low_N",
        "high": "high_N",
    },
):
    """One test, and of each sample the time (s), kind of phase, displacement and measured force.

    mean: of the posterior; low, high: ends of the 90 % predictive interval; left_out: readings
    that are not among the samples.
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
    left_out: tuple[LeftOut, ...] = ()


class Curves(Result, frozen=True, kw_only=True, rename={"noise": "noise_N"}):
    """The samples of one pad that were looked at, at most 300 a phase: ``curves.json``."""

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
    """What was looked at of a checked pad."""
    units = checked.experiment.units
    return Curves(
        pad=checked.check.pad,
        effects=checked.check.effects,
        units=units,
        force_unit=units.force,
        force_name=units.force_name,
        displacement_unit=units.displacement,
        displacement_name=units.displacement_name,
        speed_unit=units.speed,
        noise=checked.check.noise,
        tests=tuple(_test(prediction) for prediction in checked.predictions),
    )


def _test(prediction: Prediction) -> TestCurves:
    trial = prediction.trial
    return TestCurves(
        test=trial.name,
        role=trial.role,
        rate=float(trial.rate) if np.isfinite(trial.rate) else None,
        phases=tuple(PhaseSpan(p.kind, _short(p.start), _short(p.stop)) for p in trial.phases),
        time=tuple(_exact(t) for t in prediction.time),
        phase=tuple(str(kind) for kind in prediction.phase),
        displacement=_numbers(_displacement(prediction)),
        observed=_numbers(prediction.observed),
        mean=_numbers(prediction.mean),
        low=_numbers(prediction.low),
        high=_numbers(prediction.high),
        left_out=_left_out(trial),
    )


def _left_out(trial: Trial) -> tuple[LeftOut, ...]:
    bad = trial.left_out
    if bad is None:
        return ()
    why = [run for run in bad.runs for _ in range(run.stop - run.first)]
    values = zip(bad.time, bad.displacement, bad.force, why, strict=True)
    return tuple(
        LeftOut(_exact(t), _short(d), _short(f), run.channel, run.kind) for t, d, f, run in values
    )


def _displacement(prediction: Prediction) -> np.ndarray:
    """Measured, at the samples that were looked at (n,)."""
    test = prediction.trial.test
    return np.interp(prediction.time, test.time, test.displacement)


def _numbers(values: np.ndarray) -> tuple[float, ...]:
    return tuple(_short(value) for value in values)


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _exact(time: float) -> float:
    """Microseconds are kept also late in a test."""
    return round(float(time), 6)
