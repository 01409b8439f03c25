"""The names of a diagnosis: the decision by probabilities, of effects whose certainty is enough.

What is measured in the records beyond doubt, as a pull or a mass, decides between names. Any other
effect that is probable by the fit is named if its certainty is enough: it is calibrated on blind
studies, by how much and how surely tests left out are predicted better with it, and by how much of
its force one strength makes (`certainty`). It also needs a probability of its own over all
hypotheses, free curves among them.

Effects that follow the largest depth so far are distinguished by how they grow with it. One test
that loads to one depth does not show this: it then hangs on the elastic law alone which of them is
probable, and where several are named, one of them is.

An effect that is probable only together with a refused one is not probable. The decision is
therefore made again, as if nothing could be there but the effects that it named before, or had in a
group, and that were not refused. Nothing counts as explained where structure that matters is left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.outcome import SearchOutcome
from qlvbayes.diagnosis.checks.support import with_support
from qlvbayes.diagnosis.decision import (
    Decision,
    Weight,
    apply_adequacy,
    decide,
    ignore_unmodelled,
    one_of,
    restrict_to,
)
from qlvbayes.diagnosis.result import Estimate, Ranked
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import by_family
from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.io.wording import percent, plain
from qlvbayes.motion.experiment import Experiment


def final_decision(
    outcome: SearchOutcome, ranking: Sequence[Ranked]
) -> tuple[Decision, tuple[tuple[str, str], ...], tuple[Ranked, ...]]:
    """Return the decision, probable effects not named with reasons, and the ranking."""
    settings = outcome.search.settings
    known = {one.effect: one for one in ranking}
    weights, refused = outcome.weights, dict[str, str]()
    decision = _decision_after_adequacy(outcome, weights)
    while new := refusals(decision, known, settings):
        least = min(new, key=lambda name: known[name].certainty or 0.0)
        refused[least] = new[least]
        weights = restrict_to(weights, {*decision.effects, *decision.group} - {least})
        decision = _decision_after_adequacy(outcome, weights)
        for name in decision.tried:
            known[name] = with_support(outcome, known[name], decision.selected)
    decision = one_of(decision, outcome.alike, settings.group)
    return decision, tuple(refused.items()), tuple(known.values())


def _decision_after_adequacy(outcome: SearchOutcome, weights: Sequence[Weight]) -> Decision:
    """Return the decision, which also depends on the structure that its hypothesis leaves."""
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


def refusals(
    decision: Decision, known: Mapping[str, Ranked], settings: DiagnosisSettings
) -> dict[str, str]:
    """Return the effects of a decision that must not be named, with the reasons."""
    refused = {}
    for name in decision.tried:
        reason = _against(known[name], settings, alone=name not in decision.group)
        if reason is not None:
            refused[name] = reason
    return refused


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


def _is_adequate(outcome: SearchOutcome, candidate: Candidate) -> bool:
    """Return whether what a candidate leaves passes as noise or is small."""
    tested, remainder = outcome.adequacy(candidate), outcome.remainder(candidate)
    if not tested.testable:
        return outcome.beyond_white(candidate) <= remainder.tolerance * remainder.peak
    return tested.is_sound(outcome.search.settings) or remainder.is_small


_BEYOND = 2.0  # standard errors of both together


def is_gap(constant: str) -> bool:
    """Return whether a constant, such as ``contact_offset.gap``, is where contact begins."""
    effect, _, name = constant.partition(".")
    kinds = by_family().get(ContactOffset.name, [])
    return name == "gap" and effect in [kind.name for kind in kinds]


def contact_error(experiment: Experiment) -> float | None:
    """Return the standard error of the contact of all tests together; None if none was measured."""
    tests = [trial.test for trial in experiment.trials if trial.test.contact_sd]
    own = {test.contact_stage or str(k): test.contact_sd for k, test in enumerate(tests)}
    sds = np.array([sd for sd in own.values() if sd])
    return float(np.sum(sds**-2.0) ** -0.5) if sds.size else None


def contact_notices(experiment: Experiment, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return a sentence on each contact offset: within the measured contact's error, or beyond."""
    error = contact_error(experiment)
    if error is None:
        return ()
    notices = []
    for name, gap in estimates.items():
        if not is_gap(name):
            continue
        text = f"pad {experiment.pad}: {name.removesuffix('.gap')} of {gap} "
        known = f"contact, which is known to {plain(error, 2)} {gap.unit}"
        if abs(gap.mean) > _BEYOND * np.hypot(gap.sd, error):
            text += f"contradicts the measured {known}. One of the two is wrong: another effect "
            text += "looks like an offset, or drag, a film or a lag has moved the measured onset "
            text += "of the force. The option --contact states a contact where a machine's file "
            text += "is read"
        else:
            text += f"agrees with the measured {known}: it corrects it, and is no other effect"
        notices.append(text)
    return tuple(notices)
