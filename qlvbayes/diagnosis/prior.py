"""The prior probability of a hypothesis."""

from __future__ import annotations

import math
from collections.abc import Collection

from qlvbayes.diagnosis.settings import Settings
from qlvbayes.inference.space import Hypothesis


def log_prior(
    hypothesis: Hypothesis,
    usual: Hypothesis,
    laws: tuple[Collection[str], Collection[str]],
    candidates: int,
    settings: Settings,
) -> float:
    r"""Log prior probability; laws: elastic ones and relaxations; candidates: effects in all.

    What the usual hypothesis has is in every one. Sets of k effects are equally
    likely: p(set) = c (1 - c)^k / (N over k).
    """
    count = len(hypothesis.effects - usual.effects)
    candidates -= len(usual.effects)
    total = math.log(settings.complete) + count * math.log1p(-settings.complete)
    total -= math.log(math.comb(candidates, count))
    pairs = (
        (hypothesis.elastic, usual.elastic, laws[0]),
        (hypothesis.relaxation, usual.relaxation, laws[1]),
    )
    for law, own, known in pairs:
        if len(known) > 1:
            share = settings.usual if law == own else (1.0 - settings.usual) / (len(known) - 1)
            total += math.log(share)
    return total


def log_odds_of_effect(candidates: int, settings: Settings) -> float:
    """Log prior odds that one effect is in: sets are c (1 - c)^k likely, k of N effects in them."""
    missing = 1.0 - settings.complete
    expected = sum(settings.complete * missing**k * k for k in range(candidates + 1))
    share = min(expected / candidates, 0.5)
    return math.log(share) - math.log1p(-share)
