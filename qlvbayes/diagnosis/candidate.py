"""A candidate: a hypothesis at one of its modes, with the evidence about that mode."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.evidence import Evidence, evidence
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import Mode
from qlvbayes.io.arrays import Array

STIFFNESS = "stiffness"
"""The name of what scatters between tests beside the strengths of effects."""
_TRIED = 20  # draws for each that is kept, of which those beyond a bound are left out


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis at one of its modes."""

    hypothesis: Hypothesis  # base laws and effects
    mode: Mode  # a local maximum of its posterior density
    # moments of the posterior about the mode, and its integral for each size of discrepancy
    evidence: Evidence
    # log of the marginal likelihood, for effects that are large enough to matter
    log_evidence: float
    # sd of the log evidence where it was sampled; nan where it is Laplace's approximation
    error: float = math.nan

    @property
    def point(self) -> Point:
        """The constants at the mode, with the forces and slopes there."""
        return self.mode.point

    @property
    def scatter(self) -> dict[str, float]:
        """The relative sds between tests of the stiffness and of the effects' strengths."""
        own = self.point.own
        by_number = {leaf.theta.start: name for name, leaf in own.by_name.items()}
        names = [STIFFNESS, *(by_number[k].partition(".")[0] for k in own.amplitudes)]
        sizes = self.point.separation.scatter.sizes
        return {name: size for name, size in zip(names, sizes, strict=False) if size > 0.0}

    def draws(
        self, count: int, rng: np.random.Generator, *, moved: bool = True
    ) -> dict[str, Array]:
        """Return draws (count,) of each of the model's constants, within their priors' bounds.

        moved: whether they contain what a discrepancy may have moved the constants by, beside the
        curve that follows the data.
        """
        own, evidence = self.point.own, self.evidence
        thetas = rng.multivariate_normal(
            evidence.mean,
            evidence.covariance + moved * evidence.spread,
            _TRIED * count,
            check_valid="ignore",
            method="eigh",
        )
        inside = np.all((thetas >= own.lowest) & (thetas <= own.highest), axis=1)
        kept = np.concatenate([thetas[inside], own.within(thetas[~inside])])[:count]
        named = zip(own.names, own.constants(kept).T, strict=True)
        return {name: values for name, values in named if not name.startswith("noise.")}


def candidate_at(
    density: Density, hypothesis: Hypothesis, mode: Mode, tolerance: float
) -> Candidate:
    """Return a hypothesis at a mode with Laplace's evidence about it."""
    laplace = evidence(density, mode.point, mode.size)
    log = laplace.log
    for amplitude in mode.point.own.amplitude_of.values():
        if math.isfinite(log):
            k = amplitude.number
            sd = math.sqrt(max(laplace.covariance[k, k], 0.0))
            log += log_noticeable(amplitude.prior, float(laplace.mean[k]), sd, tolerance)
    mode.point.separation.forget()
    return Candidate(hypothesis, mode, laplace, log)


def described(hypothesis: Hypothesis) -> str:
    """Return a hypothesis in words, such as ``exponential, prony:2 + friction``."""
    laws = f"{hypothesis.elastic}, {hypothesis.relaxation}"
    return " + ".join((laws, *sorted(hypothesis.effects)))
