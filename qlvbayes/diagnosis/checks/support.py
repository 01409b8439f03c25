r"""Measure the support for an effect: signs for or against it in addition to its evidence.

All figures compare the most probable hypothesis that has the effect with the same without it. The
errors on tests left out count where the effect acts: with e the force that it adds and r the
residual of a test by a fit to all others, over the samples of the n parts left out,

.. math:: E^2 = \frac{\sum e^2 r^2}{\sum e^2}, \quad
          \text{gain} = \ln \frac{E_{without}}{E_{with}}, \quad
          \text{sds} = \frac{\bar d}{s_d / \sqrt n},\ d = \sum_{part}
          e^2 (r_{without}^2 - r_{with}^2).

A drag acts in ramps, which have few of the samples: what something unlisted does in long holds
says nothing about it.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import structs

from qlvbayes.diagnosis.certainty import LEAST, certainty
from qlvbayes.diagnosis.checks.outcome import SearchOutcome
from qlvbayes.diagnosis.checks.strengths import strengths
from qlvbayes.diagnosis.result import Ranked, Support
from qlvbayes.io.arrays import finite_or_none


def supported(outcome: SearchOutcome) -> tuple[Ranked, ...]:
    """Return the ranking with the support for each probable effect, and with its certainty."""
    return tuple(
        one
        if one.effect == "none" or one.inclusion < LEAST
        else with_support(outcome, one, outcome.most_probable(outcome.having(one.effect)))
        for one in outcome.ranking()
    )


def with_support(outcome: SearchOutcome, ranked: Ranked, index: int) -> Ranked:
    """Return an effect with the support for it, and its certainty, in one hypothesis."""
    own = support(outcome, ranked.effect, index)
    sure = certainty(ranked.inclusion, ranked.log_bayes_factor, own)
    if own is not None and own.heldout is None:  # it adds no force
        sure = 0.0
    if ranked.effect in outcome.measured:
        sure = max(sure or 0.0, outcome.search.settings.measured)
    return structs.replace(ranked, support=own, certainty=sure)


def support(outcome: SearchOutcome, effect: str, index: int) -> Support | None:
    """Return the support for an effect in a hypothesis that has it."""
    search = outcome.search
    having, form = outcome.candidates[index], outcome.weights[index].forms.get(effect, effect)
    without = search.without(having, effect)
    if without is None:
        return None
    weights = [np.square(one) for one in outcome.acting(having, form)]
    total = float(sum(one.sum() for one in weights))
    adds = total > 0.0 and math.isfinite(total)
    squares = [
        np.array([w @ np.square(part.residual) for w, part in zip(weights, left, strict=True)])
        for left in map(outcome.left_out, (without, having))
    ]
    noise = outcome.experiment.floor.total
    return Support(
        heldout_gain=0.5 * _log_ratio(*(float(one.sum()) for one in squares)),
        heldout_sds=_paired(*squares),
        heldout=finite_or_none(math.sqrt(float(squares[1].sum()) / total)) if adds else None,
        error_left=_log_ratio(outcome.samples.error(outcome.residuals(having)), noise),
        p_left=outcome.adequacy(having).p_value,
        effects=len(search.added(having.hypothesis)),
        strengths=strengths(
            search.density, outcome.samples, having, form, search.settings.imitation
        ),
    )


def _log_ratio(first: float, second: float) -> float:
    """Return ln(first / second); 0 where it is not finite."""
    if not (first > 0.0 and second > 0.0):  # false for NaN
        return 0.0
    return math.log(first / second)


def _paired(before: np.ndarray, after: np.ndarray) -> float:
    """Return the mean of before - after over its standard error; 0 of fewer than three parts."""
    falls = before - after
    if falls.size < 3 or not np.isfinite(falls).all():
        return 0.0
    error = falls.std(ddof=1) / math.sqrt(falls.size)
    return float(falls.mean() / error) if error > 0.0 else 0.0
