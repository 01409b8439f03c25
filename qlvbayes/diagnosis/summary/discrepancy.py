r"""The discrepancy: what the selected hypothesis leaves, as a smooth function of the motion.

With the discrepancy's whitened features B (`inference.errors.features`), the variances D of its
rough part and of noise, and the size s that is likeliest, the coefficients w ~ N(0, s^2) given the
whitened residual r of the block means are normal,

.. math:: C = (s^{-2} + B D^{-1} B^T)^{-1}, \quad \hat w = C B D^{-1} r,

and the discrepancy at any sample is phi^T w. It is an alarm, not an explanation: it says nothing
about what is missing, and must not be read as a correction of the material's constants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.summary.work import DiagnosisWork
from qlvbayes.inference.errors.features import Features, Locations
from qlvbayes.io.arrays import Array


@dataclass(frozen=True, eq=False)
class DiscrepancyBand:
    """Mean (N) and sd (N) of the discrepancy at one test's samples (n,)."""

    mean: Array
    sd: Array


def discrepancy(work: DiagnosisWork) -> list[DiscrepancyBand]:
    """Return the discrepancy at every test's samples; it is zero where its likeliest size is."""
    samples, selected = work.samples, work.selected
    size, point = selected.mode.size, selected.point
    if size == 0.0:
        return [DiscrepancyBand(np.zeros(own.size), np.zeros(own.size)) for own in samples.rows]
    blocks = samples.space.record.blocks
    prior = work.search.settings.discrepancy
    features = Features.from_locations(
        Locations.from_blocks(work.experiment, samples.trials, blocks, prior)
    )
    # only the smooth functions: the signatures of effects are not defined at single samples
    smooth = len(features.factor)
    mean, root = work.search.density.discrepancy.weights(point.residual, size, smooth)
    forces = samples.predict(selected.hypothesis, point.constants[None])
    bands = []
    for k, (trial, rows) in enumerate(zip(samples.trials, samples.rows, strict=True)):
        locations = Locations.from_trial(
            work.experiment, trial, k, trial.test.time[rows], forces[k][0], prior
        )
        own = features(locations)
        bands.append(DiscrepancyBand(mean @ own, np.sqrt(np.sum((root @ own) ** 2, axis=0))))
    return bands
