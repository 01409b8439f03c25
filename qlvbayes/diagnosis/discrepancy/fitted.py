"""A discrepancy fitted to what one model leaves of all tests."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qlvbayes.diagnosis.discrepancy.band import Band, band_of
from qlvbayes.diagnosis.discrepancy.coverage import HeldOutCoverage, held_out_coverage
from qlvbayes.diagnosis.discrepancy.points import of_tests, residuals_of
from qlvbayes.diagnosis.discrepancy.process import (
    Residuals,
    conditional,
    first_guess,
    fit_scales,
)
from qlvbayes.diagnosis.verdict import Work
from qlvbayes.inference.gaussnewton import Point


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """The process fitted to what one model leaves of all tests. An alarm, not an explanation.

    log_scales (5,): log of the sizes a and p (N), of the lengths over log time, depth (of the
    largest) and log rate; sd: typical size (N), root mean square over the points.
    """

    work: Work
    point: Point
    residuals: Residuals
    log_scales: np.ndarray
    sd: float

    def predict(self) -> list[Band]:
        """The discrepancy at the samples of every trial."""
        forces = self.work.samples.predict(self.point.constants[None])[0]
        return [
            band_of(self.work, self.residuals, self.log_scales, k, force)
            for k, force in enumerate(forces)
        ]

    @cached_property
    def held_out_coverage(self) -> HeldOutCoverage:
        """Model and process refitted with each test left out in turn."""
        return held_out_coverage(self.work, self.point, self.log_scales)


def fit_discrepancy(work: Work, point: Point) -> Discrepancy:
    """Fit the process to the residuals of a model, by the highest marginal likelihood."""
    residuals = residuals_of(work, point)
    log_scales = fit_scales(residuals, first_guess(residuals))
    mean, variance = conditional(log_scales, residuals, residuals.inputs)
    square = (np.asarray(mean) ** 2 + np.asarray(variance))[of_tests(residuals)]
    return Discrepancy(work, point, residuals, log_scales, float(np.sqrt(np.mean(square))))
