"""Where a model fails: test by test and phase by phase, against the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from qlvbayes.kinematics.phases import KINDS, phase_index
from qlvbayes.predict import Prediction
from qlvbayes.units import PAD, UnitSystem

FALSE_ALARMS = 0.01  # probability that any cell of a right model is called failing


@dataclass(frozen=True)
class Cell:
    """One test's samples in one kind of phase.

    rmse, bias: of observed minus predicted mean (N); coverage90: share of samples within the 90 %
    predictive interval; p_value: probability of an rmse at least as large if the model were right,
    from posterior draws plus the noise floor.
    """

    test: str
    role: str
    rate: float | None
    phase: str
    n: int
    rmse: float
    bias: float
    coverage90: float
    p_value: float


@dataclass(frozen=True)
class Cycle:
    """One phase of a test that has several of its kind: a cycle's loading, a staircase's step.

    number: from 1, in order of time; rmse, bias: as in `Cell` (N).
    """

    test: str
    phase: str
    number: int
    n: int
    rmse: float
    bias: float


@dataclass(frozen=True)
class Check:
    """All cells of one pad, the noise floor (sd, in the unit of force) and which cells fail.

    cycles: the phases of tests that have several of a kind, one by one; notices: about the
    measurements and their noise.
    """

    pad: str
    noise: float
    cells: tuple[Cell, ...]
    effects: tuple[str, ...] = ()
    units: UnitSystem = PAD
    notices: tuple[str, ...] = ()
    cycles: tuple[Cycle, ...] = ()

    def fails(self, cell: Cell) -> bool:
        """Whether structure beyond noise is left in a cell (1 % false alarms over all cells)."""
        return cell.p_value < FALSE_ALARMS / len(self.cells)

    def as_dict(self) -> dict:
        """The content of ``check.json``."""
        cells = [
            {
                "test": c.test,
                "role": c.role,
                "rate_mm_s": c.rate,
                "phase": c.phase,
                "n": c.n,
                "rmse_N": c.rmse,
                "bias_N": c.bias,
                "coverage90": c.coverage90,
                "p_value": c.p_value,
                "fails": self.fails(c),
            }
            for c in self.cells
        ]
        return {
            "schema": 1,
            "pad": self.pad,
            "effects": list(self.effects),
            "units": self.units.as_dict(),
            "noise_N": self.noise,
            "cells": cells,
            "cycles": [
                {
                    "test": c.test,
                    "phase": c.phase,
                    "number": c.number,
                    "n": c.n,
                    "rmse_N": c.rmse,
                    "bias_N": c.bias,
                }
                for c in self.cycles
            ],
            "notices": list(self.notices),
        }


def check(
    pad: str,
    noise: float,
    predictions: Sequence[Prediction],
    effects: Sequence[str] = (),
) -> Check:
    """Compare predictions with what was measured; cells without samples are left out."""
    cells = [
        _cell(prediction, kind)
        for prediction in predictions
        for kind in KINDS
        if np.any(prediction.phase == kind)
    ]
    cycles = tuple(cycle for prediction in predictions for cycle in _cycles(prediction))
    return Check(pad, noise, tuple(cells), tuple(effects), cycles=cycles)


def _cell(prediction: Prediction, kind: str) -> Cell:
    here = prediction.phase == kind
    residual = prediction.residual[here]
    inside = (prediction.observed >= prediction.low) & (prediction.observed <= prediction.high)
    trial = prediction.trial
    rmse = _rmse(residual)
    return Cell(
        test=trial.name,
        role=trial.role,
        rate=_finite(trial.rate),
        phase=kind,
        n=int(here.sum()),
        rmse=rmse,
        bias=float(residual.mean()),
        coverage90=float(inside[here].mean()),
        p_value=_p_value(rmse, prediction, here),
    )


def _cycles(prediction: Prediction) -> list[Cycle]:
    """Every phase by itself, of kinds that the test has several of."""
    phases = prediction.trial.phases
    place = phase_index(phases, prediction.time)
    found = []
    for kind in KINDS:
        places = [k for k, phase in enumerate(phases) if phase.kind == kind]
        for number, k in enumerate(places, start=1):
            residual = prediction.residual[place == k]
            if len(places) > 1 and residual.size:
                name, bias = prediction.trial.name, float(residual.mean())
                found.append(Cycle(name, kind, number, residual.size, _rmse(residual), bias))
    return found


def _rmse(residual: np.ndarray) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def _finite(rate: float) -> float | None:
    return float(rate) if np.isfinite(rate) else None


def _p_value(rmse: float, prediction: Prediction, here: np.ndarray) -> float:
    """Upper tail of the mean square of normal errors, whose draws are a few hundred.

    The mean square is a sum of chi-squares, few of them where noise is correlated over much of the
    cell. A chi-square with the same mean, variance and skewness has the same upper tail (Pearson's
    approximation; Imhof 1961, doi:10.1093/biomet/48.3-4.419).
    """
    error = (prediction.forces - prediction.mean + prediction.floor)[:, here]
    mean, variance, third = _cumulants(error)
    if variance <= 0.0:
        return float(rmse**2 <= mean)
    freedom = 8.0 * variance**3 / max(third, 1e-3 * variance**1.5) ** 2
    place = (rmse**2 - mean) / np.sqrt(variance)
    return float(chi2.sf(freedom + np.sqrt(2.0 * freedom) * place, freedom))


def _cumulants(error: np.ndarray) -> tuple[float, float, float]:
    """First three cumulants of the mean square of a normal error of which rows are draws.

    With A the error's covariance over its length: tr A, 2 tr A^2 and 8 tr A^3. Products of
    different draws estimate the traces without bias, and better than the squares' own moments.
    """
    draws, size = error.shape
    products = error @ error.T / size
    mean = float(np.trace(products)) / draws
    np.fill_diagonal(products, 0.0)
    twice = products @ products
    second = np.trace(twice) / (draws * (draws - 1))
    third = np.sum(twice * products) / (draws * (draws - 1) * (draws - 2))
    return mean, 2.0 * float(second), 8.0 * float(third)
