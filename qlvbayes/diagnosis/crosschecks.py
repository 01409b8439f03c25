r"""Places from which a mode that was missed would be found: checks that need not know the truth.

*Nested hypotheses.* With an amplitude a whose prior is pi, the evidences of a hypothesis H + effect
and of H must keep

.. math:: \frac{Z_{H + e}}{Z_H} = \frac{\pi(0)}{p(a = 0 \mid data, H + e)}

(Savage-Dickey; Dickey 1971, doi:10.1214/aoms/1177693507). It is asked where the posterior reaches
nothing: farther out no density there is known. Where it fails, one of the two was left at a lower
mode, and each is optimised from the other's.

*Exchangeable modes.* An extra mode of the relaxation may have taken the place of one that the law
has: H is optimised from the spectrum of H + mode with each mode left out in turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.fixedrates import relaxation_of
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import FEW, Space
from qlvbayes.inference.projection import with_curve
from qlvbayes.inference.starts import amplitude_of, shapes, transferred

Array = NDArray[np.float64]

_REACHED = 3.0  # sds of an amplitude from nothing, up to which its density there is known


class Start(NamedTuple):
    """A place, theta (F,), from which a check wants a hypothesis optimised."""

    hypothesis: Hypothesis
    theta: Array


def nested_starts(
    density: Density,
    seen: Mapping[Hypothesis, Weighed],
    hypothesis: Hypothesis,
    effect: str,
    apart: float,
    tolerance: float,
) -> list[Start] | None:
    """Of a hypothesis with an effect and the one without, where their evidences do not agree.

    apart: log Bayes factor up to which they do; tolerance: share of the peak force below which an
    effect does not matter. None where the ratio cannot be asked for: without an amplitude, one of
    the two not seen, or nothing too far from the posterior.
    """
    less = hypothesis.less(effect)
    if less not in seen:
        return None
    fuller, bare = seen[hypothesis], seen[less]
    expected = savage_dickey(fuller, effect, tolerance)
    if expected is None:
        return None
    if abs(fuller.log_evidence - bare.log_evidence - expected) < apart:
        return []
    own, old = fuller.point, bare.point
    back = transferred(own.own, own.theta, old.own)
    forth = shapes(density.space, old, own.own, effect, count=1)[0]
    return [Start(less, back), Start(hypothesis, forth)]


def savage_dickey(fuller: Weighed, effect: str, tolerance: float) -> float | None:
    """Log Bayes factor of an effect by the densities of its amplitude at nothing.

    With a prior that leaves out what does not matter, as evidences have it (`noticeable`). None
    where nothing is far from the posterior, or there is no amplitude.
    """
    own = fuller.point.own
    amplitude = amplitude_of(own, effect)
    if amplitude is None or not math.isfinite(fuller.log_evidence):
        return None
    k = amplitude.number
    mean, sd = float(fuller.evidence.mean[k]), math.sqrt(fuller.evidence.covariance[k, k])
    prior = next(leaf.prior.inner for leaf in own.leaves if leaf.theta.start == k)  # type: ignore[attr-defined]
    if abs(mean) > _REACHED * sd:
        return None
    within = norm.logsf(own.lowest[k], mean, sd) if own.lowest[k] == 0.0 else 0.0
    there = norm.logpdf(0.0, mean, sd) - within
    return float(prior.log_density(0.0) - there) + log_noticeable(prior, mean, sd, tolerance)


def exchanged_starts(space: Space, fuller: Weighed, effects: Iterable[str]) -> Iterator[Start]:
    """Of the hypothesis without one of some effects on the relaxation, each mode left out in turn.

    None where the spectrum is a long one, whose modes are not of their own.
    """
    hypothesis, point = fuller.hypothesis, fuller.point
    for effect in sorted(space.relaxing.intersection(effects)):
        less = hypothesis.less(effect)
        fractions, rates = space.spectra(hypothesis, point.constants[None])
        if rates.shape[1] > FEW + 1:
            continue
        theta = transferred(point.own, point.theta, space.parameters(less))
        for k in range(rates.shape[1]):
            rest = np.delete(fractions, k + 1, axis=1)
            rest /= rest.sum(axis=1, keepdims=True)
            goal = relaxation_of(rest, np.delete(rates, k, axis=1), space.curve_grids[1])[0]
            yield Start(less, with_curve(space, less, "relaxation", goal, theta))
