r"""Leave one test out: what hypotheses predict of each test from all the others.

Of one test alone its phases are left out, one after another. The prediction of several hypotheses
weighs each by its evidence from what was not left out,

.. math:: \hat F = \sum_H P(H \mid \text{others})\, F_H(\hat\theta_H)

(within a hypothesis the mode stands for the mean, to the first order in its numbers).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from qlvbayes.diagnosis.checks.samples import Mask, Samples, rmse
from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.evidence import evidence
from qlvbayes.inference.modes import find_mode

Array = NDArray[np.float64]


class Part(NamedTuple):
    """What is left out: the density of all else, which test, and which of its samples."""

    density: Density
    test: int
    rows: Mask


class Predicted(NamedTuple):
    """Of a part left out: force (n,) that a hypothesis predicts, fitted to the rest at a point."""

    force: Array
    density: Density
    point: Point

    @property
    def log_evidence(self) -> float:
        """From the rest."""
        return evidence(self.density, self.point).log


@dataclass(frozen=True)
class HeldOut:
    """Root mean square errors (N) on what was not fitted: over all samples, of each part left out.

    Both are nan where there is one test of one phase only, which nothing predicts.
    """

    rmse: float
    by_part: tuple[float, ...]

    @classmethod
    def of(cls, residuals: list[Array]) -> HeldOut:
        """Of each part's."""
        if not residuals:
            return cls(math.nan, ())
        return cls(rmse(residuals), tuple(rmse([one]) for one in residuals))


def held_out(density: Density, samples: Samples, found: Weighed) -> HeldOut:
    """Refit with each test (or phase) left out in turn, from the mode of all."""
    parts = leave_out(density, samples)
    return errors(samples, parts, [predictions(samples, parts, found)])


def errors(
    samples: Samples,
    parts: Sequence[Part],
    predicted: Sequence[Sequence[Predicted]],
    log_prior: Sequence[float] = (),
) -> HeldOut:
    """Of what hypotheses predict of each part, together; log_prior: of each, where several do."""
    residuals = []
    for part, *each in zip(parts, *predicted, strict=True):
        weights = np.ones(1)
        if len(each) > 1:
            logs = [p.log_evidence + log for p, log in zip(each, log_prior, strict=True)]
            weights = softmax(logs)
        mean = weights @ np.array([p.force for p in each])
        residuals.append(samples.observed[part.test][part.rows] - mean)
    return HeldOut.of(residuals)


def leave_out(density: Density, samples: Samples) -> list[Part]:
    """Each test, or of one alone each of its phases."""
    return [Part(density.without(out), k, rows) for out, k, rows in samples.left_out()]


def predictions(samples: Samples, parts: Sequence[Part], found: Weighed) -> list[Predicted]:
    """Of each part, from the mode of all."""
    return [_predicted(samples, part, found) for part in parts]


def _predicted(samples: Samples, part: Part, found: Weighed) -> Predicted:
    mode = find_mode(part.density, found.hypothesis, found.point.theta)
    point = mode.point if mode is not None else found.point
    force = samples.predict(found.hypothesis, point.constants[None])[part.test][0][part.rows]
    return Predicted(force, part.density, point)
