r"""The decision: a pure function of probabilities and of the measured support of each effect.

Each hypothesis H has a log posterior and the probability that the data also hold something
unmodelled (the discrepancy is larger than the tolerance). An effect's inclusion probability is the
sum over all hypotheses that contain it,

.. math:: P(e) = \sum_{H \ni e} P(H).

An effect is named if this probability is `DiagnosisSettings.named` or more (`decide`). Where no
single effect reaches it, the smallest set that holds one of its members with probability
`DiagnosisSettings.covered` is the group. The forms of one effect (its family) count together, under
the name of the candidate effect. An effect that belongs to no candidate's family names nothing: a
hypothesis that contains one holds something unmodelled.

What is named also needs support (`decide_with_support`). What is measured in the records beyond
doubt, as a pull or a mass, has it. Any other effect has it if its certainty is enough: it is
calibrated on blind studies, by how much and how surely tests left out are predicted better with it,
and by how much of its force one strength makes (`certainty`). It also needs a probability of its
own over all hypotheses, free curves among them. An effect that is probable only together with one
that lacks support is not probable: the decision is that of the hypotheses with no effects but those
that it named before, or had in a group, and that have support. Nothing counts as explained where
structure that matters is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar

import numpy as np
from scipy.special import softmax

from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import Ranked, Verdict
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.io.arrays import Array
from qlvbayes.io.wording import percent, plain

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
    # effects that are probable and not named, with the reasons
    refused: dict[str, str] = field(default_factory=dict)

    @property
    def tried(self) -> tuple[str, ...]:
        """Effects of the selected hypothesis, unless the verdict is `Verdict.UNEXPLAINED`."""
        return (*self.effects, *self.group[:1])


def decide(weights: Sequence[Weight], settings: DiagnosisSettings | None = None) -> Decision:
    """Return the decision from the probabilities alone."""
    settings = settings or DiagnosisSettings()
    shares = probabilities(weights).mean(axis=0)
    pairs = list(zip(weights, shares.tolist(), strict=True))
    inclusion = sum_by_key((name, p) for w, p in pairs for name in w.effects)
    base = sum_by_key((w.base, p) for w, p in pairs)
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
    inside = [replace(weight, unmodelled=0.0) for weight in weights]
    return _only(inside, [weight.nameable for weight in weights])


def restrict_to(weights: Sequence[Weight], effects: Collection[str]) -> list[Weight]:
    """Return the weights as they are if no effects but these can be there."""
    return _only(weights, [weight.effects <= set(effects) for weight in weights])


def require(weights: Sequence[Weight], effects: set[str]) -> list[Weight]:
    """Return the weights as they are if some effects are there, where any hypothesis has them."""
    having = [effects <= weight.effects for weight in weights]
    known = any(own and weight.counts for own, weight in zip(having, weights, strict=True))
    return _only(weights, having) if known else list(weights)


def _only(weights: Sequence[Weight], some: Sequence[bool]) -> list[Weight]:
    """Return the weights as they are if only some hypotheses are possible."""
    return [
        weight if own else replace(weight, log_posterior=-np.inf)
        for own, weight in zip(some, weights, strict=True)
    ]


def decide_with_support(
    weights: Sequence[Weight],
    ranking: Sequence[Ranked],
    settings: DiagnosisSettings,
    *,
    adequate: Callable[[int], bool],
    supported: Callable[[Ranked, int], Ranked],
    alike: Collection[str] = (),
) -> tuple[Decision, tuple[Ranked, ...]]:
    """Return the decision after what was measured, and the ranking with the support it rests on.

    Parameters
    ----------
    weights, ranking, settings
        The figures of all hypotheses; every effect with its probability and its support in its
        likeliest hypothesis; the thresholds.
    adequate, supported
        Whether what a hypothesis leaves, by its index, passes as noise or is small; an effect with
        its support and certainty in a hypothesis.
    alike
        Effects that these tests cannot distinguish, whatever their probabilities.
    """
    known, refused = {one.effect: one for one in ranking}, dict[str, str]()
    decision = _after_adequacy(weights, settings, adequate)
    while new := refusals(decision, known, settings):
        least = min(new, key=lambda name: known[name].certainty or 0.0)
        refused[least] = new[least]
        weights = restrict_to(weights, {*decision.effects, *decision.group} - {least})
        decision = _after_adequacy(weights, settings, adequate)
        for name in decision.tried:
            known[name] = supported(known[name], decision.selected)
    decision = replace(one_of(decision, alike, settings.group), refused=refused)
    return decision, tuple(known.values())


def _after_adequacy(
    weights: Sequence[Weight], settings: DiagnosisSettings, adequate: Callable[[int], bool]
) -> Decision:
    """Return the decision, which also depends on the structure that its hypothesis leaves."""
    decision = decide(weights, settings)
    if decision.verdict.has_unmodelled:
        modelled = ignore_unmodelled(weights)
        inside = decide(modelled, settings)
        if not adequate(inside.selected):
            return decision
        return replace(inside, unmodelled=decision.unmodelled)
    if adequate(decision.selected):
        return decision
    if decision.effects:
        return replace(decision, verdict=Verdict.PARTLY_EXPLAINED, group=())
    selected = int(np.argmax([weight.log_posterior for weight in weights]))
    return replace(decision, verdict=Verdict.UNEXPLAINED, group=(), selected=selected)


def refusals(
    decision: Decision, known: Mapping[str, Ranked], settings: DiagnosisSettings
) -> dict[str, str]:
    """Return the effects of a decision that lack support, with the reasons."""
    reasons = {
        name: _against(known[name], settings, alone=name not in decision.group)
        for name in decision.tried
    }
    return {name: reason for name, reason in reasons.items() if reason is not None}


def _against(ranked: Ranked, settings: DiagnosisSettings, *, alone: bool) -> str | None:
    """Return why an effect must not be named; of a group, only what speaks against each member."""
    sure, own = ranked.certainty, ranked.support
    if own is None or sure is None or (alone and sure >= settings.confirmed):
        below = alone and ranked.inclusion < settings.likelier
        return (
            f"over all hypotheses its probability is {percent(ranked.inclusion)}" if below else None
        )
    if own.heldout is None:
        return "at its likeliest constants it adds no force"
    if own.heldout_gain < 0.0:
        return "tests left out are predicted worse with it"
    if not alone:
        return None
    if own.strengths is not None and sure >= settings.confirmed * own.strengths.agreement:
        low, high = own.strengths.range
        return (
            f"from test to test its strength would have to be {plain(low, 2)} to {plain(high, 2)} "
            "times its mean: something else looks like it"
        )
    return f"in blind studies an effect with such evidence and support was there in {percent(sure)}"


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


def sum_by_key(pairs: Iterable[tuple[Key, float]]) -> dict[Key, float]:
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
        left = sum_by_key(
            (n, share) for rest, share in others if not rest & set(group) for n in rest
        )
        if not left:
            break
        group.append(next(iter(left)))
    return tuple(group)
