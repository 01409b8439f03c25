"""Measured and predicted force of every test, as numbers for whoever draws them later."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from qlvbayes.fitting.checked import CheckedPad
from qlvbayes.fitting.prediction import Prediction
from qlvbayes.io.resultfile import Part, Result
from qlvbayes.io.units import PAD, UnitSystem

_DIGITS = 5  # significant, of every number


class PhaseSpan(Part, frozen=True, rename={"start": "start_s", "stop": "stop_s"}):
    """A phase of a test: its kind, and from when to when (s)."""

    kind: str
    start: float
    stop: float


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

    mean: of the posterior; low, high: ends of the 90 % predictive interval.
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
