r"""Which share of the change that an effect makes on a test left out is there.

A test is left out. Fitted to all others, the hypothesis with the effect predicts the block means
of its force as F_1, and the one without it as F_0: the effect changes the prediction by
:math:`d = F_1 - F_0`, where the measured force differs by :math:`r = F - F_0`. With C the
covariance of noise, discrepancy and scatter between tests, S that of the fitted constants and J
the slopes of the test's force, the share of the change that is there is the coefficient of r on d
(a regression of forecast encompassing, Chong & Hendry 1986, doi:10.2307/2297428),

.. math:: s = \frac{d^T K^{-1} r}{d^T K^{-1} d}, \quad \sigma = (d^T K^{-1} d)^{-1/2}, \quad
          K = C + J S J^T.

It is 1 where the effect does in this test what it does in all others, and 0 where nothing of it is
there, whatever the size of the force in the test, and however stiff the test is by itself. Over n
tests left out (the phases, where there is only one test) the shares scatter by tau about their
mean, by moments (random effects, DerSimonian & Laird 1986, doi:10.1016/0197-2456(86)90046-2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.outcome import SearchOutcome
from qlvbayes.inference.evidence import evidence
from qlvbayes.io.arrays import Array

_LEAST_PARTS = 3  # shares, from which their scatter is known


def share_that_is_there(
    outcome: SearchOutcome, without: Candidate, having: Candidate
) -> tuple[float, float] | None:
    """Return the mean share and its sd; None of fewer than three parts that the effect changes."""
    found = [one for one in _shares(outcome, without, having) if np.isfinite(one).all()]
    return pooled(*np.array(found).T) if len(found) >= _LEAST_PARTS else None


def pooled(shares: Array, sds: Array) -> tuple[float, float]:
    """Return the mean of shares (n,) with sds (n,), and its sd, with their scatter."""
    weights = sds**-2.0
    total = float(weights.sum())
    off = shares - weights @ shares / total
    excess = float(weights @ off**2) - (shares.size - 1)
    scatter = max(excess / (total - float(weights @ weights) / total), 0.0)
    weights = 1.0 / (sds**2 + scatter)
    return float(weights @ shares / weights.sum()), float(weights.sum()) ** -0.5


def _shares(
    outcome: SearchOutcome, without: Candidate, having: Candidate
) -> Iterator[tuple[float, float]]:
    """Yield the share of each part left out, with its sd; not finite where nothing changes."""
    density = outcome.search.density
    real, force = density.space.real, np.asarray(density.space.record.blocks.force)
    sized = density.discrepancy.at(having.mode.size, having.point.separation)
    pairs = zip(outcome.predicted(without), outcome.predicted(having), strict=True)
    for (part, first), (_, second) in pairs:
        here = np.zeros(real.shape, dtype=bool)
        here[real] = part.blocks
        before, after = first.point.predicted, second.point.predicted
        variances, axes = np.linalg.eigh(evidence(second.density, second.point).covariance)
        # the force changes by these columns for one sd of each principal axis of the constants
        principal = axes * np.sqrt(np.maximum(variances, 0.0))
        errors = np.tensordot(principal.T, second.point.responses, axes=1)
        columns = np.concatenate([np.stack([force - before, after - before]), errors])
        products = sized.products(density.whitener(np.where(here, columns, 0.0)))
        own, mixed = products[:2, :2], products[2:, :2]
        inner = np.eye(len(errors)) + products[2:, 2:]
        there, change = (own - mixed.T @ np.linalg.solve(inner, mixed))[1]
        yield (there / change, change**-0.5) if change > 0.0 else (math.nan, math.inf)
    having.point.separation.forget()
