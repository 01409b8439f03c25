"""The summary of a finished search: every field of ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from msgspec import structs

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.naming import contact_notices, final_decision, is_gap
from qlvbayes.diagnosis.checks.outcome import LEAST, SearchOutcome
from qlvbayes.diagnosis.checks.sensitivity import (
    parameter_biases,
    responses,
    unmeasured,
    unseen,
)
from qlvbayes.diagnosis.checks.support import supported
from qlvbayes.diagnosis.decision import Decision, Verdict
from qlvbayes.diagnosis.description.describe import NOTHING, Described, describe
from qlvbayes.diagnosis.nexttest.planning import suggest
from qlvbayes.diagnosis.result import (
    Base,
    DiagnosisResult,
    Excluded,
    Suggestion,
    Worst,
)
from qlvbayes.diagnosis.search import Report, Search
from qlvbayes.diagnosis.searchsetup import protocol_of
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.diagnosis.summary.work import DiagnosisWork
from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.arrays import Array
from qlvbayes.io.wording import joined, percent
from qlvbayes.laws.relaxation.law import unresolved_times
from qlvbayes.motion.evidence import DirectEvidence
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.record import Record
from qlvbayes.motion.specimen import carryover_notices


def summarize(
    experiment: Experiment,
    search: Search,
    shown: tuple[DirectEvidence, ...],
    kinds: Sequence[type[AbstractEffect]],
    bonded: bool,
    report: Report,
) -> Diagnosis:
    """Return the diagnosis that follows from a finished search and what the record shows."""
    outcome = SearchOutcome(experiment, search)
    report("tests left out, and what is left")
    decision, refused, ranking = final_decision(outcome, supported(outcome))
    selected = outcome.candidates[decision.selected]
    path = _path(search, selected)
    report("what these tests cannot show")
    result = DiagnosisResult(
        pad=experiment.pad,
        units=experiment.units,
        noise=experiment.floor.total,
        refused=tuple(Excluded(name, why) for name, why in refused),
        **_decided(outcome, decision, selected),
        ranking=ranking,
        **_left(outcome, selected, path),
        **_not_shown(outcome, kinds, bonded),
        notices=_notices(outcome, decision, selected),
        direct_evidence=shown,
    )
    law = _law(outcome, decision, selected, bonded, report)
    result = structs.replace(result, description=law.record, could_remove=law.families)
    return Diagnosis(result, DiagnosisWork(experiment, search, outcome.samples, path, law))


def _law(
    outcome: SearchOutcome, decision: Decision, selected: Candidate, bonded: bool, report: Report
) -> Described:
    """Return the law that describes what is left beside the named effects, where that matters."""
    search = outcome.search
    if not decision.verdict.has_unmodelled or not search.settings.description.fitted:
        return NOTHING
    forms = search.families.forms_in(selected.hypothesis.effects)
    named = {forms[name] for name in decision.effects if name in forms}
    protocol = protocol_of(outcome.experiment, bonded=bonded, settings=search.settings)
    return describe(outcome, search.baseline.effects | named, protocol, report)


def _decided(outcome: SearchOutcome, decision: Decision, selected: Candidate) -> dict[str, Any]:
    """Return the fields that say what is missing, and with which laws and constants."""
    own, shares = selected.hypothesis.base, decision.base
    unexplained = decision.verdict is Verdict.UNEXPLAINED
    return {
        "verdict": decision.verdict,
        "effects": decision.tried,
        "group": decision.group,
        "forms": _forms(outcome.search, selected, decision),
        "base": Base(*own, shares[own]),
        "bases": tuple(Base(*laws, share) for laws, share in shares.items() if share >= LEAST),
        "outside": decision.unmodelled,
        "alternatives": outcome.alternatives(),
        "not_ruled_out": () if unexplained else outcome.sets(),
        "constants": outcome.constants(selected),
        "suggestions": _suggestions(outcome, decision),
    }


def _left(outcome: SearchOutcome, selected: Candidate, path: Sequence[Candidate]) -> dict[str, Any]:
    """Return the fields on the errors: of each step, and what the selected hypothesis leaves."""
    stages = tuple(outcome.stage(one) for one in path)
    remainder, worst = outcome.remainder(selected), stages[0].worst
    return {
        "stages": stages,
        "discrepancy": selected.mode.size,
        "scatter": selected.scatter,
        "tolerance": remainder.tolerance,
        "remainder": remainder.record,
        "worst": Worst(worst.test, worst.phase, worst.rmse, worst.bias),
    }


def _not_shown(
    outcome: SearchOutcome, kinds: Sequence[type[AbstractEffect]], bonded: bool
) -> dict[str, Any]:
    """Return the fields on effects that the tests cannot show, and on what those would bias."""
    search = outcome.search
    baseline = search.modes[search.baseline][0]
    protocol = protocol_of(outcome.experiment, bonded=bonded, settings=search.settings)
    added = responses(search, baseline)
    candidates = [kind for kind in kinds if kind.name not in search.baseline.effects]
    return {
        "not_identifiable": (
            *unseen(added, search, protocol),
            *unmeasured(candidates, protocol),
        ),
        "biases": tuple(parameter_biases(added, baseline)),
    }


def _notices(outcome: SearchOutcome, decision: Decision, selected: Candidate) -> tuple[str, ...]:
    """Return every notice of a diagnosis; after all figures, which may find forces not finite."""
    return (
        *unlikely_over_all(outcome, decision),
        *_alike(outcome, decision),
        *_of_contact(outcome, decision, selected),
        *_not_counted(outcome),
        *_of_tests(outcome.experiment, outcome.search, selected),
    )


def _alike(outcome: SearchOutcome, decision: Decision) -> tuple[str, ...]:
    """Return a sentence where one test that loads once leaves open what follows its depth."""
    alike = [name for name in decision.group if name in outcome.alike]
    if len(alike) < 2:
        return ()
    return (
        f"pad {outcome.experiment.pad}: {joined(alike)} all follow the largest depth so far, and "
        "no load of this one test goes deeper than its first. That one of them is there is as "
        "probable as stated; which of them, or whether the specimen yielded, depends on the "
        "elastic law. Press a fresh specimen in steps to growing depths, back after each",
    )


def _of_contact(outcome: SearchOutcome, decision: Decision, selected: Candidate) -> tuple[str, ...]:
    """Return a sentence where a named contact offset and the measured contact contradict."""
    if ContactOffset.name not in decision.tried:
        return ()
    return contact_notices(outcome.experiment, outcome.estimates(selected, is_gap))


def _forms(search: Search, selected: Candidate, decision: Decision) -> dict[str, str]:
    """Return the forms of the named effects, where they are not the candidate effect itself."""
    own = search.families.forms_in(selected.hypothesis.effects)
    return {name: own[name] for name in decision.tried if own.get(name, name) != name}


def _path(search: Search, selected: Candidate) -> tuple[Candidate, ...]:
    """Return the steps from the baseline to the selected hypothesis."""
    hypothesis = replace(selected.hypothesis, effects=search.baseline.effects)
    search.evaluate(hypothesis)
    steps = [search.baseline, hypothesis]
    left = set(search.added(selected.hypothesis))
    while len(left) > 1:
        for name in left:
            search.evaluate(steps[-1].plus(name), selected.hypothesis)
        best = max(left, key=lambda name: search.log_posterior(steps[-1].plus(name)))
        steps.append(steps[-1].plus(best))
        left.remove(best)
    steps.append(selected.hypothesis)
    known = [one for one in dict.fromkeys(steps) if one in search.modes]
    return tuple(search.modes[one][0] for one in known)


def _suggestions(outcome: SearchOutcome, decision: Decision) -> tuple[Suggestion, ...]:
    """Return the tests that would best distinguish the members of a group."""
    rest = set(decision.effects)
    points = []
    for name in decision.group:
        same = [
            (weight.log_posterior, k)
            for k, weight in enumerate(outcome.weights)
            if weight.effects == rest | {name}
        ]
        if same:
            points.append(outcome.candidates[max(same)[1]])
    if len(points) < 2:
        return ()
    return tuple(suggest(outcome.experiment, points))


def unlikely_over_all(outcome: SearchOutcome, decision: Decision) -> list[str]:
    """Return a notice for each effect that is named only after a veto."""
    return [
        f"pad {outcome.experiment.pad}: {name} is named after other effects were refused "
        f"(probability {percent(decision.inclusion[name])}); over all hypotheses its "
        f"probability is {percent(outcome.inclusion(name))}"
        for name in decision.effects
        if outcome.inclusion(name) < outcome.search.settings.named
    ]


def _not_counted(outcome: SearchOutcome) -> list[str]:
    """Return notices on hypotheses whose evidence or predictions are not finite."""
    every, notices = f"of {len(outcome.weights)} hypotheses", []
    if count := outcome.without_evidence:
        notices.append(
            f"{count} {every} left out of the decision: their evidence is not a finite number"
        )
    if count := len(outcome.unpredicted):
        notices.append(
            f"{count} {every} predict no finite force at some samples, which counts as zero force"
        )
    return [f"pad {outcome.experiment.pad}: {text}" for text in notices]


def _of_tests(experiment: Experiment, search: Search, selected: Candidate) -> tuple[str, ...]:
    """Return notices on the tests by the selected hypothesis, and on an early end of the search."""
    space = search.density.space
    constants = selected.point.constants

    def predict(record: Record) -> Array:
        return space.forces(selected.hypothesis, constants[None], record)[0]

    carryover = carryover_notices(experiment, experiment.trials, space.record, predict)
    model = selected.point.own.model_at(constants)
    times = unresolved_times(model.relaxation, experiment.scales)
    notices = [f"pad {experiment.pad}: {text}" for text in (*experiment.floor.notices, *times)]
    if search.ended_early:
        notices.append(
            f"pad {experiment.pad}: the search ended after {len(search.modes)} hypotheses, because "
            "very many fit alike: probabilities are those among these hypotheses"
        )
    return (*carryover, *notices)
