"""A hypothesis at a mode, with its evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.evidence import Evidence, evidence
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import Mode
from qlvbayes.priors.natural import Natural


@dataclass(frozen=True, eq=False)
class Weighed:
    """A hypothesis at one of its modes: log evidence (with the smallest size that matters).

    error: of the log evidence where it was sampled, nan where it is Laplace's about the mode.
    """

    hypothesis: Hypothesis
    mode: Mode
    evidence: Evidence
    log_evidence: float
    error: float = math.nan

    @property
    def point(self) -> Point:
        """The mode's place."""
        return self.mode.point


def weigh(density: Density, hypothesis: Hypothesis, mode: Mode, tolerance: float) -> Weighed:
    """Evidence about a mode, of effects large enough to matter."""
    found = evidence(density, mode.point)
    log = found.log
    for leaf in mode.point.own.leaves:
        if isinstance(leaf.prior, Natural) and math.isfinite(log):
            k = leaf.theta[0]
            sd = math.sqrt(max(found.covariance[k, k], 0.0))
            log += log_noticeable(leaf.prior.inner, float(found.mean[k]), sd, tolerance)
    mode.point.separation.forget_but(mode.size)
    return Weighed(hypothesis, mode, found, log)


def described(hypothesis: Hypothesis) -> str:
    """As ``exponential, prony:2 + friction``."""
    laws = f"{hypothesis.elastic}, {hypothesis.relaxation}"
    return " + ".join((laws, *sorted(hypothesis.effects)))
