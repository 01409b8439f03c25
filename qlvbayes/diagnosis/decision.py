r"""The decision by probabilities: a pure function from a posterior over hypotheses to a verdict.

What is named by it may still be refused after checks of the tests (`checks.naming`).

Each hypothesis H has a log posterior and the probability that the data also hold something
unmodelled (the discrepancy is larger than the tolerance). An effect's inclusion probability is the
sum over all hypotheses that contain it,

.. math:: P(e) = \sum_{H \ni e} P(H).

An effect is named if this probability is `DiagnosisSettings.named` or more. Where no single effect
reaches it, the smallest set that holds one of its members with probability
`DiagnosisSettings.covered` is the group. The forms of one effect (its family) count together, under
the name of the candidate effect. An effect that belongs to no candidate's family names nothing: a
hypothesis that contains one holds something unmodelled.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Self, TypeVar

import numpy as np
from scipy.special import softmax

from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.io.arrays import Array

Key = TypeVar("Key", bound=Hashable)

_DRAWS = 256  # of log posteriors within their errors: 6 % of what these make of a probability


@dataclass(frozen=True)
class Weight:
    """The figures of one hypothesis that the decision needs."""

    base: tuple[str, str]  # names of the elastic law and of the relaxation
    effects: frozenset[str]  # names of the effects added to the baseline model, by family
    log_posterior: float  # log posterior up to a constant that all hypotheses share
    # probability that the data hold something which this hypothesis does not model
    unmodelled: float
    # whether its laws and effects all have a physical name. A free curve has none.
    nameable: bool = True
    # the form of each effect, by its family, where it is not the candidate's own law
    forms: Mapping[str, str] = field(default_factory=dict)
    error: float = math.nan  # sd of the log posterior; nan where it is not known

    @property
    def counts(self) -> bool:
        """True if the hypothesis takes part in a decision: its log posterior is finite."""
        return math.isfinite(self.log_posterior)

    def made_finite(self) -> Self:
        """Return the weight with safe values where a figure is not finite."""
        return replace(
            self,
            log_posterior=self.log_posterior if self.counts else -math.inf,
            unmodelled=self.unmodelled if self.counts and math.isfinite(self.unmodelled) else 1.0,
            error=self.error if self.counts and math.isfinite(self.error) else math.nan,
        )

    def within(self, families: Families) -> Self:
        """Return the weight with its effects named by their families instead of by themselves."""
        forms = families.forms_in(self.effects)
        return replace(
            self,
            effects=frozenset(forms),
            nameable=self.nameable and self.effects.isdisjoint(families.unmodelled),
            forms={family: form for family, form in forms.items() if form != family},
        )


@dataclass(frozen=True)
class Decision:
    """The verdict with the probabilities that it rests on."""

    verdict: Verdict
    effects: tuple[str, ...]  # names of the effects that are named, the most probable first
    # effects of which one is there, the most probable first; empty unless ambiguous
    group: tuple[str, ...]
    inclusion: dict[str, float]  # inclusion probability of every effect
    base: dict[tuple[str, str], float]  # probability of every pair of elastic law and relaxation
    unmodelled: float  # probability that something unmodelled is there
    # index of the hypothesis that stands for the answer: the most probable one with just the named
    # effects
    selected: int

    @property
    def tried(self) -> tuple[str, ...]:
        """Effects of the selected hypothesis, unless the verdict is `Verdict.UNEXPLAINED`."""
        return (*self.effects, *self.group[:1])


def decide(weights: Sequence[Weight], settings: DiagnosisSettings | None = None) -> Decision:
    """Return the decision from the probabilities alone."""
    settings = settings or DiagnosisSettings()
    shares = probabilities(weights).mean(axis=0)
    pairs = list(zip(weights, shares.tolist(), strict=True))
    inclusion = _sum_by_key((name, p) for w, p in pairs for name in w.effects)
    base = _sum_by_key((w.base, p) for w, p in pairs)
    unmodelled = sum(p * (w.unmodelled if w.nameable else 1.0) for w, p in pairs)
    named = tuple(name for name, p in inclusion.items() if p >= settings.named)
    if unmodelled > settings.likelier:
        group: tuple[str, ...] = ()
        verdict = Verdict.PARTLY_EXPLAINED if named else Verdict.UNEXPLAINED
    else:
        group = _group(pairs, named, settings)
        verdict = Verdict.MISSING_EFFECT if named else Verdict.ADEQUATE
        verdict = Verdict.AMBIGUOUS if group else verdict
    selected = _selected(weights, {*named, *group[:1]})
    if verdict is Verdict.UNEXPLAINED:
        selected = int(np.argmax(shares))
    return Decision(verdict, named, group, inclusion, base, unmodelled, selected)


def probabilities(weights: Sequence[Weight]) -> Array:
    """Return draws (D, H) of the probabilities of H hypotheses."""
    logs = np.array([weight.log_posterior for weight in weights])
    errors = np.nan_to_num(np.array([weight.error for weight in weights]))
    draws = np.random.default_rng(0).standard_normal((_DRAWS, logs.size))
    return np.asarray(softmax(logs + errors * draws, axis=1))


def ignore_unmodelled(weights: Sequence[Weight]) -> list[Weight]:
    """Return the weights as they are if nothing unmodelled is there."""
    return [
        replace(w, unmodelled=0.0, log_posterior=w.log_posterior if w.nameable else -np.inf)
        for w in weights
    ]


def restrict_to(weights: Sequence[Weight], effects: Collection[str]) -> list[Weight]:
    """Return the weights as they are if no effects but these can be there."""
    return [w if w.effects <= set(effects) else replace(w, log_posterior=-np.inf) for w in weights]


def require(weights: Sequence[Weight], effects: set[str]) -> list[Weight]:
    """Return the weights as they are if some effects are there, where any hypothesis has them."""
    having = [effects <= w.effects for w in weights]
    if not any(own and w.counts for own, w in zip(having, weights, strict=True)):
        return list(weights)
    return [
        w if own else replace(w, log_posterior=-np.inf)
        for own, w in zip(having, weights, strict=True)
    ]


def apply_adequacy(decision: Decision, weights: Sequence[Weight], *, adequate: bool) -> Decision:
    """Return the decision after the adequacy test of its selected hypothesis."""
    if adequate or decision.verdict.has_unmodelled:
        return decision
    if decision.effects:
        return replace(decision, verdict=Verdict.PARTLY_EXPLAINED, group=())
    selected = int(np.argmax([weight.log_posterior for weight in weights]))
    return replace(decision, verdict=Verdict.UNEXPLAINED, group=(), selected=selected)


def one_of(decision: Decision, alike: Collection[str], most: int) -> Decision:
    """Return the decision where effects cannot be distinguished, whatever their probabilities."""
    same = tuple(name for name in decision.effects if name in alike)
    if len(same) < 2:
        return decision
    group = tuple(dict.fromkeys((*same, *decision.group)))[:most]
    others = tuple(name for name in decision.effects if name not in same)
    return replace(decision, verdict=Verdict.AMBIGUOUS, effects=others, group=group)


def _selected(weights: Sequence[Weight], effects: set[str]) -> int:
    """Return the index of the most probable hypothesis with just these effects."""
    logs = np.array([weight.log_posterior for weight in weights])
    same = np.array([weight.effects == effects for weight in weights])
    return int(np.argmax(np.where(same, logs, -np.inf) if same.any() else logs))


def _sum_by_key(pairs: Iterable[tuple[Key, float]]) -> dict[Key, float]:
    """Return the summed probability of each key, the largest first."""
    totals: dict[Key, float] = {}
    for key, share in pairs:
        totals[key] = totals.get(key, 0.0) + share
    return dict(sorted(totals.items(), key=lambda item: -item[1]))


def _group(
    pairs: Sequence[tuple[Weight, float]], named: tuple[str, ...], settings: DiagnosisSettings
) -> tuple[str, ...]:
    """Return the smallest set of effects of which one is there in addition to those named."""
    others = [(weight.effects - set(named), share) for weight, share in pairs]
    if sum(share for rest, share in others if not rest) > 1.0 - settings.named:
        return ()
    group: list[str] = []
    while len(group) < settings.group:
        held = sum(share for rest, share in others if rest & set(group))
        if held >= settings.covered:
            break
        left = _sum_by_key(
            (n, share) for rest, share in others if not rest & set(group) for n in rest
        )
        if not left:
            break
        group.append(next(iter(left)))
    return tuple(group)


class Verdict(StrEnum):
    """The verdict on one pad; the values are those of ``verdict`` in ``diagnosis.json``."""

    ADEQUATE = "adequate"
    """No effect is needed, and no phase of any test shows structure that matters."""
    MISSING_EFFECT = "missing_effect"
    """The named effects are in the model and leave no structure that matters."""
    AMBIGUOUS = "ambiguous"
    """Something is missing, and a group of effects explains it equally well."""
    PARTLY_EXPLAINED = "partly_explained"
    """The named effects are in the model, and something unmodelled is there too."""
    UNEXPLAINED = "unexplained"
    """Structure remains, and no effect can be named."""

    @property
    def has_unmodelled(self) -> bool:
        """True if the verdict says that something is there which no candidate effect is."""
        return self in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED)
