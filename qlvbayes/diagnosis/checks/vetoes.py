"""What is told of a finished search: the decision by probabilities, and what may veto it.

An effect with which tests left out are predicted worse is not named; nor one whose strength would
have to vary from test to test, nor one beside something unlisted that takes more of the error than
it; and nothing is explained where what is left matters.
Likely beside an effect that is not to be named is not likely: after a veto the decision is made
again, as if nothing could be there but what it named before, or had in a group, and was not vetoed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from qlvbayes.diagnosis.checks.constancy import varies
from qlvbayes.diagnosis.checks.outcome import Outcome
from qlvbayes.diagnosis.decision import (
    LEFT,
    Decision,
    Weight,
    decide,
    listed,
    of_effects,
    unless_sound,
)
from qlvbayes.diagnosis.search import Tell
from qlvbayes.diagnosis.weighed import Weighed

RISES = "tests left out are predicted worse with it"
VARIES = "its strength would have to vary between tests or phases: something else looks like it"
IMITATES = "it explains less of the error than what no effect explains, and may be a part of that"


def decided(outcome: Outcome, tell: Tell) -> tuple[Decision, tuple[tuple[str, str], ...]]:
    """The decision after all vetoes, and effects refused with the reason."""
    tell("tests left out, and what is left")
    weights, refused = outcome.weights, dict[str, str]()
    decision = _tested(outcome, weights)
    while new := _refused(outcome, decision):
        refused |= new
        weights = of_effects(weights, {*decision.effects, *decision.group} - set(new))
        decision = _tested(outcome, weights)
    return decision, tuple(refused.items())


def _tested(outcome: Outcome, weights: Sequence[Weight]) -> Decision:
    """The decision, by whether what it tells leaves what matters."""
    settings = outcome.search.settings
    decision = decide(weights, settings)
    if decision.verdict in LEFT:
        inside = decide(listed(weights), settings)
        if _is_enough(outcome, outcome.seen[inside.told]):
            weights = listed(weights)
            decision = replace(inside, outside=decision.outside)
    sound = _is_enough(outcome, outcome.seen[decision.told])
    return unless_sound(decision, weights, sound=sound)


def _refused(outcome: Outcome, decision: Decision) -> dict[str, str]:
    """Effects that are not to be named, with the reason."""
    told = outcome.seen[decision.told]
    refused = {name: VARIES for name in decision.tried if _varies(outcome, told, name)}
    others = [name for name in decision.tried if name not in refused]
    refused |= {name: RISES for name in others if _rises(outcome, told, name)}
    if refused or decision.verdict != "partly_explained":
        return refused
    return {name: IMITATES for name in decision.effects if _takes_little(outcome, told, name)}


def _is_enough(outcome: Outcome, told: Weighed) -> bool:
    """Whether what a hypothesis leaves passes as noise or is small.

    Where no dwell shows whether noise is correlated, structure may have been measured as noise: the
    size decides then, of all that exceeds the white noise.
    """
    tested, left = outcome.tested(told), outcome.left(told)
    if not tested.testable:
        return outcome.beyond_white(told) <= left.tolerance * left.peak
    return tested.is_sound(outcome.search.settings) or left.is_small


def _member(outcome: Outcome, told: Weighed, effect: str) -> str | None:
    """The form in which a hypothesis has an effect; None if it has not got it."""
    families = outcome.search.families
    own = outcome.search.added(told.hypothesis)
    return next((member for member in own if families.of[member] == effect), None)


def _without(outcome: Outcome, told: Weighed, effect: str) -> Weighed | None:
    """A hypothesis less one of its effects, in whichever form; None if it has not got it."""
    member, search = _member(outcome, told, effect), outcome.search
    if member is None:
        return None
    search.see(told.hypothesis.less(member), told.hypothesis)
    found = search.modes.get(told.hypothesis.less(member))
    return found[0] if found else None


def _varies(outcome: Outcome, told: Weighed, effect: str) -> bool:
    """Whether an effect would need other strengths from test to test."""
    member = _member(outcome, told, effect)
    if member is None:
        return False
    return varies(outcome.search, outcome.samples, told, member)


def _rises(outcome: Outcome, told: Weighed, effect: str) -> bool:
    """Whether tests left out are predicted worse with an effect than without."""
    without = _without(outcome, told, effect)
    if without is None:
        return False
    limit = (1.0 + outcome.search.settings.rise) * outcome.heldout(without)
    return bool(outcome.heldout(told) > limit)


def _takes_little(outcome: Outcome, told: Weighed, effect: str) -> bool:
    """Whether an effect takes less of the squared error than what no effect explains.

    Then it may as well imitate a part of that.
    """
    without = _without(outcome, told, effect)
    if without is None:
        return False
    return bool(outcome.left(without).excess ** 2 < 2.0 * outcome.left(told).excess ** 2)
