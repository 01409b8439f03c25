"""Compare a saved fit with a pad's tests: predictions, where they fail, and curves to plot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from qlvbayes.fitting.prediction import Prediction, predict
from qlvbayes.fitting.residuals import CheckResult, check_experiment
from qlvbayes.fitting.results import Saved
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.model.drawn import factors
from qlvbayes.model.elsewhere import has_noise
from qlvbayes.motion.experiment import Experiment, Trial

_DIGITS = 5  # significant digits


@dataclass(frozen=True, eq=False)
class CheckedPad:
    """The tests of one pad, their predictions, and the comparison by test and phase."""

    experiment: Experiment
    predictions: tuple[Prediction, ...]
    check: CheckResult


def check_pad(saved: Saved, pad: Pad, *, seed: int = 0) -> CheckedPad:
    """Predict all tests of a pad from a saved posterior, and check them."""
    if not has_noise(saved.names):
        raise InputError(
            f"the posterior of pad {saved.pad} has no noise",
            remedy="give draws of noise.white, or also of noise.ou and noise.tau",
        )
    experiment = saved.choices.prepare(pad, all_tests=saved.all_tests)
    constants = dict(zip(saved.names, saved.curve_draws.T, strict=True))
    scales = factors(saved.choices, constants, saved.units, pad.units)
    constants = {name: scales[name] * draws for name, draws in constants.items()}
    predictions = predict(experiment, saved.choices, constants, experiment.trials, seed=seed)
    check = check_experiment(experiment, saved.choices, predictions)
    return CheckedPad(experiment, tuple(predictions), check)


class PhaseSpan(Part, frozen=True, rename={"start": "start_s", "stop": "stop_s"}):
    """A phase of a test: its kind, and its beginning and end (s)."""

    kind: str
    start: float
    stop: float


class LeftOut(
    Part,
    frozen=True,
    rename={"time": "time_s", "displacement": "displacement_mm", "force": "force_N"},
):
    """A reading that was left out: time (s), displacement, force, channel and why."""

    time: float
    displacement: float
    force: float
    channel: str
    # the fault, or ``excluded`` where the user leaves the force out; of a long run of these there
    # are fifty, evenly spaced
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
    left_out: tuple[LeftOut, ...] = ()


class Curves(Result, frozen=True, kw_only=True, rename={"noise": "noise_N"}):
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
    """Return the curves of one test."""
    trial = prediction.trial
    return TestCurves(
        test=trial.name,
        role=trial.role,
        rate=float(trial.rate) if np.isfinite(trial.rate) else None,
        phases=tuple(PhaseSpan(p.kind, _short(p.start), _short(p.stop)) for p in trial.phases),
        time=tuple(_exact(t) for t in prediction.time),
        phase=tuple(str(kind) for kind in prediction.phase),
        displacement=_rounded(_displacement(prediction)),
        observed=_rounded(prediction.observed),
        mean=_rounded(prediction.mean),
        low=_rounded(prediction.low),
        high=_rounded(prediction.high),
        left_out=_left_out(trial),
    )


def _left_out(trial: Trial) -> tuple[LeftOut, ...]:
    """Return the readings of a trial that were left out."""
    unused = trial.left_out
    if unused is None:
        return ()
    shown = []
    for k in unused.drawn.tolist():
        kind, channel = unused.reason[k].split(" ")[:2]
        values = _exact(unused.time[k]), _short(unused.displacement[k]), _short(unused.force[k])
        shown.append(LeftOut(*values, "force" if kind == "excluded" else channel, kind))
    return tuple(shown)


def _displacement(prediction: Prediction) -> np.ndarray:
    """Return the measured displacement (n,) at the samples of a prediction."""
    test = prediction.trial.test
    return np.interp(prediction.time, test.time, test.displacement)


def _rounded(values: np.ndarray) -> tuple[float, ...]:
    """Return values as a tuple, rounded."""
    return tuple(_short(value) for value in values)


def _short(value: float) -> float:
    """Return a value rounded to five significant digits."""
    return float(f"{value:.{_DIGITS}g}")


def _exact(time: float) -> float:
    """Return a time rounded to microseconds, which also resolves times late in a test."""
    return round(float(time), 6)
