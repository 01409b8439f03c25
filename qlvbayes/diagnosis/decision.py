r"""What is said of a posterior over hypotheses: a function of numbers alone.

Each hypothesis H has a log posterior and the probability that something outside the list is beside
it (its discrepancy is larger than the tolerance). An effect's inclusion probability is summed over
everything else,

.. math:: P(e) = \sum_{H \ni e} P(H).

An effect is named from 0.9 on; where none alone reaches it, the smallest set that holds one of its
members with 0.95 is the group. Effects of one family count as one, by the listed one's name; those
of no family of the list name nothing: a hypothesis that has one has something outside beside it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.settings import Settings

Array = NDArray[np.float64]
Key = TypeVar("Key", bound=Hashable)

VERDICTS = ("adequate", "missing_effect", "ambiguous", "partly_explained", "unexplained")
LEFT = VERDICTS[3:]
"""Verdicts that something outside the list is there."""
_DRAWS = 256  # of log posteriors within their errors: 6 % of what these make of a probability


@dataclass(frozen=True)
class Weight:
    """A hypothesis in numbers.

    effects: by the names of their families; outside: probability of something that no list holds
    beside it; listed: whether its laws and effects all name something; forms: of each effect, by
    its family, where that is not the listed law itself; error: of the log posterior, nan where it
    is not known.
    """

    base: tuple[str, str]
    effects: frozenset[str]
    log_posterior: float
    outside: float
    listed: bool = True
    forms: Mapping[str, str] = field(default_factory=dict)
    error: float = math.nan

    @property
    def counts(self) -> bool:
        """Whether it takes part in a decision: its log posterior is a number."""
        return math.isfinite(self.log_posterior)

    def of_numbers(self) -> Self:
        """Without what is no number: a hypothesis that has none takes no part in a decision."""
        return replace(
            self,
            log_posterior=self.log_posterior if self.counts else -math.inf,
            outside=self.outside if self.counts and math.isfinite(self.outside) else 1.0,
            error=self.error if self.counts and math.isfinite(self.error) else math.nan,
        )

    def within(self, families: Families) -> Self:
        """Of a hypothesis whose effects are told by their own names: by those of families."""
        named = families.named(self.effects)
        return replace(
            self,
            effects=frozenset(named),
            listed=self.listed and self.effects.isdisjoint(families.outside),
            forms={family: form for family, form in named.items() if form != family},
        )


@dataclass(frozen=True)
class Decision:
    """The verdict and what it is made of.

    effects: named, the surest first; group: one of which is there, the likeliest first; inclusion:
    of every effect; base: probability of every base; outside: that something unlisted is there;
    told: place of the hypothesis that stands for the answer, the likeliest with just these effects.
    """

    verdict: str
    effects: tuple[str, ...]
    group: tuple[str, ...]
    inclusion: dict[str, float]
    base: dict[tuple[str, str], float]
    outside: float
    told: int

    @property
    def tried(self) -> tuple[str, ...]:
        """Effects of the hypothesis told, if its verdict is none of `unexplained`."""
        return (*self.effects, *self.group[:1])


def decide(weights: Sequence[Weight], settings: Settings | None = None) -> Decision:
    """Of all hypotheses seen, before what is told is tested: see `vetoes`."""
    settings = settings or Settings()
    shares = probabilities(weights).mean(axis=0)
    pairs = list(zip(weights, shares.tolist(), strict=True))
    inclusion = _summed((name, p) for w, p in pairs for name in w.effects)
    base = _summed((w.base, p) for w, p in pairs)
    outside = sum(p * (w.outside if w.listed else 1.0) for w, p in pairs)
    named = tuple(name for name, p in inclusion.items() if p >= settings.named)
    if outside > settings.unlisted:
        group: tuple[str, ...] = ()
        verdict = "partly_explained" if named else "unexplained"
    else:
        group = _group(pairs, named, settings)
        verdict = "ambiguous" if group else "missing_effect" if named else "adequate"
    told = _told(weights, {*named, *group[:1]})
    if verdict == "unexplained":
        told = int(np.argmax(shares))
    return Decision(verdict, named, group, inclusion, base, outside, told)


def probabilities(weights: Sequence[Weight]) -> Array:
    """(D, H) of H hypotheses, as the errors of their log posteriors leave them open: D draws."""
    logs = np.array([weight.log_posterior for weight in weights])
    errors = np.nan_to_num(np.array([weight.error for weight in weights]))
    draws = np.random.default_rng(0).standard_normal((_DRAWS, logs.size))
    return np.asarray(softmax(logs + errors * draws, axis=1))


def listed(weights: Sequence[Weight]) -> list[Weight]:
    """As if nothing were outside: what the listed laws leave passes as noise, or is small."""
    return [
        replace(w, outside=0.0, log_posterior=w.log_posterior if w.listed else -np.inf)
        for w in weights
    ]


def of_effects(weights: Sequence[Weight], effects: Collection[str]) -> list[Weight]:
    """As if no other effects could be there."""
    return [w if w.effects <= set(effects) else replace(w, log_posterior=-np.inf) for w in weights]


def unless_sound(decision: Decision, weights: Sequence[Weight], *, sound: bool) -> Decision:
    """What is told leaves structure that matters: it is not all."""
    if sound or decision.verdict in LEFT:
        return decision
    if decision.effects:
        return replace(decision, verdict="partly_explained", group=())
    told = int(np.argmax([weight.log_posterior for weight in weights]))
    return replace(decision, verdict="unexplained", group=(), told=told)


def _told(weights: Sequence[Weight], effects: set[str]) -> int:
    """The likeliest hypothesis with just these effects; the likeliest of all if none was seen."""
    logs = np.array([weight.log_posterior for weight in weights])
    same = np.array([weight.effects == effects for weight in weights])
    return int(np.argmax(np.where(same, logs, -np.inf) if same.any() else logs))


def _summed(pairs: Iterable[tuple[Key, float]]) -> dict[Key, float]:
    """Probabilities by key, the largest first."""
    found: dict[Key, float] = {}
    for key, share in pairs:
        found[key] = found.get(key, 0.0) + share
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _group(
    pairs: Sequence[tuple[Weight, float]], named: tuple[str, ...], settings: Settings
) -> tuple[str, ...]:
    """Smallest set of which one is there besides what is named, if something surely is."""
    others = [(weight.effects - set(named), share) for weight, share in pairs]
    if sum(share for rest, share in others if not rest) > 1.0 - settings.named:
        return ()
    group: list[str] = []
    while len(group) < settings.group:
        held = sum(share for rest, share in others if rest & set(group))
        if held >= settings.covered:
            break
        left = _summed((n, share) for rest, share in others if not rest & set(group) for n in rest)
        if not left:
            break
        group.append(next(iter(left)))
    return tuple(group)
