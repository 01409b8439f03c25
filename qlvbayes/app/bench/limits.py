"""Compute the error that noise and the motion's errors alone make in a cell of test and phase."""

from __future__ import annotations

import numpy as np

from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.fitting.residuals import FALSE_ALARMS, error_limit
from qlvbayes.io.arrays import Array
from qlvbayes.motion.phases import KINDS


def cell_limits(samples: Samples) -> dict[tuple[str, str], float]:
    """Return the root mean square, by test and phase, beyond which a model set by hand fails.

    It is the limit of the check of a fit (`qlvbayes.fitting.residuals`), for constants that are
    known exactly: noise, and errors of the motion and of the zero of displacement, exceed it in
    1 % of pads.
    """
    cells = {}
    for k, trial in enumerate(samples.trials):
        covariance, phases = _covariance(samples, k), samples.phases(k)
        for kind in KINDS:
            here = np.flatnonzero(phases == kind)
            if here.size:
                cells[trial.name, kind] = _cumulants(covariance[np.ix_(here, here)])
    level = FALSE_ALARMS / max(len(cells), 1)
    return {cell: error_limit(cumulants, level) for cell, cumulants in cells.items()}


def _covariance(samples: Samples, k: int) -> Array:
    """Return the covariance (n, n) of the errors of the samples of test k (N^2)."""
    floor, time = samples.experiment.floor, samples.trials[k].test.time[samples.rows[k]]
    scale, weight, extra, timing = (
        samples.of_blocks(k, name) for name in ("scale", "weight", "extra", "timing")
    )
    blocks, real = samples.space.record.blocks, samples.space.real[k]
    middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))[k, real]
    contact = np.interp(time, middle, np.asarray(blocks.contact)[k, real])
    correlated = floor.ou**2 * np.exp(-np.abs(time[:, None] - time) / floor.tau)
    noise = np.outer(scale, scale) * (correlated + np.diag((floor.white * weight) ** 2))
    common = np.outer(extra, extra) + np.outer(contact, contact)
    tare = samples.trials[k].test.tare_sd
    return np.asarray(noise + np.diag(timing**2) + common + tare**2)


def _cumulants(covariance: Array) -> tuple[float, float, float]:
    """Return the first three cumulants of the mean square of a normal of this covariance."""
    scaled = covariance / len(covariance)
    squared = scaled @ scaled
    third = 8.0 * float(np.sum(squared * scaled))
    return float(np.trace(scaled)), 2.0 * float(np.trace(squared)), third
