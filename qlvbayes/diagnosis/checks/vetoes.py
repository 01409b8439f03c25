"""The final decision on a finished search: the decision by probabilities, after all vetoes.

An effect is refused where tests left out are predicted worse with it, where its strength would have
to vary from test to test, or where something unmodelled takes more of the error than the effect.
It is also refused where its certainty is small: in blind studies with such evidence and support
the effect was mostly not there. Nothing counts as explained where structure that matters is left.

Effects that follow the largest depth so far are distinguished by how they grow with it. One test
that loads to one depth does not show this: it then hangs on the elastic law alone which of them is
probable, and where several are named, one of them is.

An effect that is probable only together with a refused one is not probable. After a veto the
decision is therefore made again, as if nothing could be there but the effects that it named before,
or had in a group, and that were not refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.constancy import varies
from qlvbayes.diagnosis.checks.outcome import SearchOutcome
from qlvbayes.diagnosis.decision import (
    Decision,
    Weight,
    apply_adequacy,
    decide,
    ignore_unmodelled,
    one_of,
    restrict_to,
)
from qlvbayes.diagnosis.result import Ranked
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.verdict import Verdict

RISES = "tests left out are predicted worse with it"
VARIES = "its strength would have to vary between tests or phases: something else looks like it"
UNCONFIRMED = "in blind studies an effect with such evidence and support was mostly not there"
IMITATES = "it explains less of the error than what no effect explains, and may be a part of that"


def final_decision(
    outcome: SearchOutcome, ranking: Sequence[Ranked]
) -> tuple[Decision, tuple[tuple[str, str], ...]]:
    """Return the decision after all vetoes, and the refused effects with the reason of each."""
    settings = outcome.search.settings
    weights, refused = outcome.weights, dict[str, str]()
    decision = _decision_after_adequacy(outcome, weights)
    while new := _refused(outcome, decision) or _unconfirmed(decision, ranking, settings):
        refused |= new
        weights = restrict_to(weights, {*decision.effects, *decision.group} - set(new))
        decision = _decision_after_adequacy(outcome, weights)
    decision = one_of(decision, outcome.alike, settings.group)
    return decision, tuple(refused.items())


def _decision_after_adequacy(outcome: SearchOutcome, weights: Sequence[Weight]) -> Decision:
    """Return the decision, which also depends on the structure that its hypothesis leaves.

    Where the nameable hypotheses alone leave nothing that matters, nothing unmodelled is there.
    """
    settings = outcome.search.settings
    decision = decide(weights, settings)
    if decision.verdict.has_unmodelled:
        modelled = ignore_unmodelled(weights)
        inside = decide(modelled, settings)
        if _is_adequate(outcome, outcome.candidates[inside.selected]):
            weights = modelled
            decision = replace(inside, unmodelled=decision.unmodelled)
    adequate = _is_adequate(outcome, outcome.candidates[decision.selected])
    return apply_adequacy(decision, weights, adequate=adequate)


def _refused(outcome: SearchOutcome, decision: Decision) -> dict[str, str]:
    """Return the effects of a decision that must not be named, with the reasons."""
    selected = outcome.candidates[decision.selected]
    refused = {name: VARIES for name in decision.tried if _varies(outcome, selected, name)}
    others = [name for name in decision.tried if name not in refused]
    refused |= {name: RISES for name in others if _raises_error(outcome, selected, name)}
    if refused or decision.verdict is not Verdict.PARTLY_EXPLAINED:
        return refused
    return {name: IMITATES for name in decision.effects if _takes_little(outcome, selected, name)}


def _unconfirmed(
    decision: Decision, ranking: Sequence[Ranked], settings: DiagnosisSettings
) -> dict[str, str]:
    """Return the named effects of little certainty; an effect without a certainty stays."""
    known = {one.effect: one.certainty for one in ranking if one.certainty is not None}
    named = [name for name in decision.effects if name not in decision.group]
    return {name: UNCONFIRMED for name in named if known.get(name, 1.0) < settings.confirmed}


def _is_adequate(outcome: SearchOutcome, candidate: Candidate) -> bool:
    """Return whether what a candidate leaves passes as noise or is small.

    Where no dwell shows whether noise is correlated, structure may have been measured as noise.
    Then the size decides, of all that exceeds the white noise.
    """
    tested, remainder = outcome.adequacy(candidate), outcome.remainder(candidate)
    if not tested.testable:
        return outcome.beyond_white(candidate) <= remainder.tolerance * remainder.peak
    return tested.is_sound(outcome.search.settings) or remainder.is_small


def _varies(outcome: SearchOutcome, candidate: Candidate, effect: str) -> bool:
    """Return whether an effect would need other strengths from test to test."""
    form = outcome.search.form_of(candidate.hypothesis, effect)
    return form is not None and varies(outcome.search, outcome.samples, candidate, form)


def _raises_error(outcome: SearchOutcome, candidate: Candidate, effect: str) -> bool:
    """Return whether tests left out are predicted worse with an effect than without."""
    without = outcome.search.without(candidate, effect)
    if without is None:
        return False
    limit = (1.0 + outcome.search.settings.rise) * outcome.heldout(without)
    return bool(outcome.heldout(candidate) > limit)


def _takes_little(outcome: SearchOutcome, candidate: Candidate, effect: str) -> bool:
    """Return whether an effect takes less of the squared error than what no effect explains.

    Then it may as well be an imitation of a part of that.
    """
    without = outcome.search.without(candidate, effect)
    if without is None:
        return False
    left = outcome.remainder(candidate).excess ** 2
    explained = outcome.remainder(without).excess ** 2 - left
    return bool(explained < outcome.search.settings.imitation.least * left)
