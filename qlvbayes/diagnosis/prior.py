"""The prior probability of a hypothesis, and the families of effects that share theirs."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Self

from qlvbayes.diagnosis.settings import Settings
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.forward.hypothesis import Hypothesis


@dataclass(frozen=True)
class Families:
    """Which candidates are of which family: the listed law and its other forms, told by one name.

    of: family of every candidate by its name, a listed effect's being its own; outside: candidates
    that name nothing, each a family of its own.
    """

    of: dict[str, str]
    outside: frozenset[str] = frozenset()

    @classmethod
    def of_kinds(cls, kinds: Iterable[type[AbstractEffect]]) -> Self:
        """By the facts of the effects' classes."""
        kinds = tuple(kinds)
        return cls(
            {kind.name: kind.family() for kind in kinds},
            frozenset(kind.name for kind in kinds if kind.outside),
        )

    @property
    def listed(self) -> list[str]:
        """Candidates that a diagnosis names."""
        return [name for name, own in self.of.items() if name == own and name not in self.outside]

    def beside(self, effects: Collection[str]) -> list[str]:
        """Candidates of families that a set of effects has none of."""
        taken = {self.of[name] for name in effects}
        return [name for name, own in self.of.items() if own not in taken]

    def members(self, family: str) -> list[str]:
        """Candidates of one family."""
        return [name for name, own in self.of.items() if own == family]

    def named(self, effects: Collection[str]) -> dict[str, str]:
        """Of a set of effects, the form in which each family is there; none of what is outside."""
        return {self.of[name]: name for name in sorted(effects) if name not in self.outside}

    def share(self, effect: str) -> float:
        """Of its family's prior probability that a member has.

        The listed law has a half, its other forms together the other; where either is no
        candidate, the others have all.
        """
        family = self.of[effect]
        forms = [name for name in self.members(family) if name != family]
        listed = family in self.of
        whole = 0.5 if listed and forms else 1.0
        return whole if effect == family else whole / len(forms)


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
