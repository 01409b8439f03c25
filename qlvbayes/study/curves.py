"""Measured and predicted force of every test, as numbers for whoever draws them later."""

from __future__ import annotations

import numpy as np

from qlvbayes.checked import CheckedPad
from qlvbayes.predict import Prediction

_DIGITS = 5  # significant, of every number


def curves(checked: CheckedPad) -> dict:
    """The content of ``curves.json``: the samples that were looked at, at most 300 a phase.

    Per test its name, role, rate and phases (kind, start, stop in s), and for each sample the time
    (s), displacement, measured force, posterior mean, and the ends of the 90 % predictive interval.
    """
    units = checked.experiment.units
    return {
        "schema": 1,
        "pad": checked.check.pad,
        "effects": list(checked.check.effects),
        "units": units.as_dict(),
        "force_unit": units.force,
        "force_name": units.force_name,
        "displacement_unit": units.displacement,
        "displacement_name": units.displacement_name,
        "speed_unit": units.speed,
        "noise_N": checked.check.noise,
        "tests": [_test(prediction) for prediction in checked.predictions],
    }


def _test(prediction: Prediction) -> dict:
    trial = prediction.trial
    return {
        "test": trial.name,
        "role": trial.role,
        "rate_mm_s": float(trial.rate) if np.isfinite(trial.rate) else None,
        "phases": [
            {"kind": phase.kind, "start_s": _short(phase.start), "stop_s": _short(phase.stop)}
            for phase in trial.phases
        ],
        "time_s": [_exact(t) for t in prediction.time],
        "phase": [str(kind) for kind in prediction.phase],
        "displacement_mm": _numbers(_displacement(prediction)),
        "observed_N": _numbers(prediction.observed),
        "mean_N": _numbers(prediction.mean),
        "low_N": _numbers(prediction.low),
        "high_N": _numbers(prediction.high),
    }


def _displacement(prediction: Prediction) -> np.ndarray:
    """Measured, at the samples that were looked at (n,)."""
    test = prediction.trial.test
    return np.interp(prediction.time, test.time, test.displacement)


def _numbers(values: np.ndarray) -> list[float]:
    return [_short(value) for value in values]


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _exact(time: float) -> float:
    """Microseconds are kept also late in a test."""
    return round(float(time), 6)
