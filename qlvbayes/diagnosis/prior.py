"""The prior probability of a hypothesis."""

from __future__ import annotations

import math
from collections.abc import Collection

from qlvbayes.diagnosis.families import Families
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.inference.hypothesis import Hypothesis


def log_prior(
    hypothesis: Hypothesis,
    usual: Hypothesis,
    laws: tuple[Collection[str], Collection[str]],
    families: Families,
    settings: Settings,
) -> float:
    r"""Log prior probability; laws: elastic ones and relaxations.

    What the usual hypothesis has is in every one. Sets of k families of N are equally likely,
    p(set) = c (1 - c)^k / (N over k), and a family's members share its probability. There is at
    most one of a family: minus infinity.
    """
    added = hypothesis.effects - usual.effects
    total = _log_prior_of_set(added, usual.effects, families, settings)
    pairs = (
        (hypothesis.elastic, usual.elastic, laws[0]),
        (hypothesis.relaxation, usual.relaxation, laws[1]),
    )
    for law, own, known in pairs:
        if len(known) > 1:
            share = settings.usual if law == own else (1.0 - settings.usual) / (len(known) - 1)
            total += math.log(share)
    return total


def _log_prior_of_set(
    added: Collection[str], usual: Collection[str], families: Families, settings: Settings
) -> float:
    taken = {families.of[name] for name in usual}
    own = {families.of[name] for name in added}
    if len(own) < len(added) or own & taken:
        return -math.inf
    free = set(families.of.values()) - taken
    missing = len(added) * math.log1p(-settings.complete)
    total = math.log(settings.complete) + missing - math.log(math.comb(len(free), len(added)))
    return total + sum(math.log(families.share(name)) for name in added)


def log_odds_of_effect(candidates: int, settings: Settings) -> float:
    """Log prior odds that one effect is in: sets are c (1 - c)^k likely, k of N effects in them."""
    missing = 1.0 - settings.complete
    expected = sum(settings.complete * missing**k * k for k in range(candidates + 1))
    share = min(expected / candidates, 0.5)
    return math.log(share) - math.log1p(-share)
