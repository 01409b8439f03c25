"""The discrepancy at the samples of one test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.discrepancy.points import inputs_at
from qlvbayes.diagnosis.discrepancy.process import Inputs, Residuals, conditional
from qlvbayes.diagnosis.verdict import Work


@dataclass(frozen=True, eq=False)
class Band:
    """One test's samples (n,): mean and sd (N) of the discrepancy there, noise not included."""

    mean: np.ndarray
    sd: np.ndarray


def band_of(
    work: Work, residuals: Residuals, log_scales: np.ndarray, k: int, force: np.ndarray
) -> Band:
    """The discrepancy at the samples of trial k, where the model's force is ``force`` (n,)."""
    samples = work.samples
    trial, rows = samples.trials[k], samples.rows[k]
    at = inputs_at(work.experiment, trial, k, trial.test.time[rows], force)
    width = samples.record.blocks.force.shape[1]  # one size for all trials
    full = Inputs(*(np.pad(x, (0, width - x.size), mode="edge") for x in at))
    mean, variance = conditional(log_scales, residuals, full)
    return Band(np.asarray(mean)[: rows.size], np.sqrt(np.asarray(variance)[: rows.size]))
