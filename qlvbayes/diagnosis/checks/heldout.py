r"""Errors on tests left out: what hypotheses predict of each test from all the others.

Where there is only one test, its phases are left out, one after another. The prediction of several
hypotheses gives each the weight of its evidence from what was not left out,

.. math:: \hat F = \sum_H P(H \mid \text{others})\, F_H(\hat\theta_H)

(within a hypothesis the mode stands for the mean, to the first order in its parameters).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import Mask, Samples, rmse
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.evidence import evidence
from qlvbayes.inference.modes import find_mode
from qlvbayes.io.arrays import Array


class HeldOutPart(NamedTuple):
    """Part of the data that is left out of a fit, to be predicted by it."""

    density: Density  # posterior density on everything else
    test: int  # index of the test that the part belongs to
    rows: Mask  # which of the test's samples it holds


class Predicted(NamedTuple):
    """The force (n,) that a hypothesis predicts of a part, fitted to everything else."""

    force: Array
    density: Density
    point: Point

    @property
    def log_evidence(self) -> float:
        """Log evidence of the hypothesis from everything else."""
        return evidence(self.density, self.point).log


@dataclass(frozen=True)
class HeldOut:
    """Root mean square errors (N) on parts that were not fitted, weighted by stated sds."""

    # error over the samples of all parts; nan where there is only one test with one phase
    rmse: float
    by_part: tuple[float, ...]

    @classmethod
    def from_residuals(cls, residuals: list[Array], sds: list[Array]) -> HeldOut:
        """Return the errors from the residuals of each part and the relative sds of its samples."""
        if not residuals:
            return cls(math.nan, ())
        by_part = (rmse([one], [own]) for one, own in zip(residuals, sds, strict=True))
        return cls(rmse(residuals, sds), tuple(by_part))


def held_out(density: Density, samples: Samples, candidate: Candidate) -> HeldOut:
    """Return the errors of a candidate that is refitted with each test left out in turn."""
    parts = leave_out(density, samples)
    return errors(samples, parts, [predictions(samples, parts, candidate)])


def errors(
    samples: Samples,
    parts: Sequence[HeldOutPart],
    predicted: Sequence[Sequence[Predicted]],
    log_prior: Sequence[float] = (),
) -> HeldOut:
    """Return the errors of what one or several hypotheses predict of each part together."""
    residuals = []
    for part, *each in zip(parts, *predicted, strict=True):
        weights = np.ones(1)
        if len(each) > 1:
            logs = [p.log_evidence + log for p, log in zip(each, log_prior, strict=True)]
            weights = softmax(logs)
        mean = weights @ np.array([p.force for p in each])
        residuals.append(samples.observed[part.test][part.rows] - mean)
    sds = [samples.weights[part.test][part.rows] for part in parts]
    return HeldOut.from_residuals(residuals, sds)


def leave_out(density: Density, samples: Samples) -> list[HeldOutPart]:
    """Return each test as a part to be left out, or each phase where there is only one test."""
    return [HeldOutPart(density.without(out), k, rows) for out, k, rows in samples.left_out()]


def predictions(
    samples: Samples, parts: Sequence[HeldOutPart], candidate: Candidate
) -> list[Predicted]:
    """Return what a candidate predicts of each part, fitted from its mode on all tests."""
    return [_predicted(samples, part, candidate) for part in parts]


def _predicted(samples: Samples, part: HeldOutPart, candidate: Candidate) -> Predicted:
    """Return what a candidate predicts of one part."""
    theta, size = candidate.point.theta, candidate.mode.size
    mode = find_mode(part.density, candidate.hypothesis, theta, guess=size)
    point = mode.point if mode is not None else candidate.point
    point.separation.forget()  # of nine long tests, all that are left out would take a gigabyte
    force = samples.predict(candidate.hypothesis, point.constants[None])[part.test][0][part.rows]
    return Predicted(force, part.density, point)
