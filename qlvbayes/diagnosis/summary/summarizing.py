"""The summary of a finished search: every field of ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.outcome import REPORTED, SearchOutcome
from qlvbayes.diagnosis.checks.sensitivity import parameter_biases, responses, unmeasured, unseen
from qlvbayes.diagnosis.checks.support import supported, with_support
from qlvbayes.diagnosis.decision import Decision, decide_with_support
from qlvbayes.diagnosis.description.describe import NOTHING, describe
from qlvbayes.diagnosis.nexttest.planning import suggest
from qlvbayes.diagnosis.result import (
    Base,
    DiagnosisResult,
    Estimate,
    Excluded,
    Suggestion,
    Used,
    Verdict,
    Worst,
)
from qlvbayes.diagnosis.search import Report, Search
from qlvbayes.diagnosis.searchsetup import protocol_of
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis, DiagnosisWork
from qlvbayes.effects.catalogue import by_family
from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.arrays import Array
from qlvbayes.io.wording import joined, percent, plain
from qlvbayes.laws.relaxation.law import unresolved_times
from qlvbayes.model.choices import Choices
from qlvbayes.motion.evidence import DirectEvidence
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.record import Record
from qlvbayes.motion.specimen import carryover_notices, pull_notices

_BEYOND = 2.0  # standard errors of a contact and an offset together, from which they contradict


def summarize(
    experiment: Experiment,
    search: Search,
    shown: tuple[DirectEvidence, ...],
    kinds: Sequence[type[AbstractEffect]],
    choices: Choices,
    report: Report,
) -> Diagnosis:
    """Return the diagnosis that follows from a finished search and what the record shows."""
    outcome, settings = SearchOutcome(experiment, search), search.settings
    protocol = protocol_of(experiment, bonded=choices.bonded, settings=settings)
    report("tests left out, and what is left")
    decision, ranking = decide_with_support(
        outcome.weights,
        supported(outcome),
        settings,
        adequate=outcome.is_adequate,
        supported=lambda ranked, index: with_support(outcome, ranked, index),
        alike=outcome.alike,
    )
    selected = outcome.candidates[decision.selected]
    path = _path(search, selected)
    report("what these tests cannot show")
    forms = search.families.forms_in(selected.hypothesis.effects)
    unexplained = decision.verdict is Verdict.UNEXPLAINED
    stages = tuple(map(outcome.stage, path))
    worst = stages[0].worst
    baseline, chosen = outcome.baseline, search.baseline.effects
    added, candidates = responses(search, baseline), [x for x in kinds if x.name not in chosen]
    law, space = NOTHING, search.density.space
    left = outcome.remainder(selected).record
    # after all figures, which may find forces not finite
    notices = _notices(outcome, decision, selected, (*choices.effects, *decision.tried))
    if decision.verdict.has_unmodelled and settings.description.fitted:
        named = {forms[name] for name in decision.effects if name in forms}
        law = describe(outcome, chosen | named, protocol, report)
    result = DiagnosisResult(
        pad=experiment.pad,
        units=experiment.units,
        noise=experiment.floor.total,
        verdict=decision.verdict,
        effects=decision.tried,
        group=decision.group,
        refused=tuple(Excluded(name, why) for name, why in decision.refused.items()),
        forms={one: forms[one] for one in decision.tried if forms.get(one, one) != one},
        base=Base(*selected.hypothesis.base, decision.base[selected.hypothesis.base]),
        bases=tuple(Base(*laws, p) for laws, p in decision.base.items() if p >= REPORTED),
        outside=decision.unmodelled,
        alternatives=outcome.alternatives(),
        not_ruled_out=() if unexplained else outcome.sets(),
        constants=outcome.constants(selected),
        suggestions=_suggestions(outcome, decision),
        stages=stages,
        ranking=ranking,
        not_identifiable=(*unseen(added, search, protocol), *unmeasured(candidates, protocol)),
        biases=tuple(parameter_biases(added, baseline)),
        discrepancy=selected.mode.size,
        scatter=selected.scatter,
        tolerance=settings.tolerance,
        remainder=left,
        worst=Worst(worst.test, worst.phase, worst.rmse, worst.bias),
        notices=notices,
        direct_evidence=shown,
        description=law.record,
        could_remove=law.families,
        settings=Used(
            thresholds=settings,
            seed=search.seed,
            elastic=tuple(space.elastic),
            relaxation=tuple(space.relaxation),
            effects=tuple(space.effects),
        ),
    )
    return Diagnosis(result, DiagnosisWork(experiment, search, outcome.samples, path, law))


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
    points = []
    for name in decision.group:
        effects = {*decision.effects, name}
        same = [k for k, weight in enumerate(outcome.weights) if weight.effects == effects]
        if same:
            points.append(outcome.candidates[max(same, key=lambda k: (outcome.logs[k], k))])
    return tuple(suggest(outcome.experiment, points)) if len(points) > 1 else ()


def _notices(
    outcome: SearchOutcome, decision: Decision, selected: Candidate, known: tuple[str, ...]
) -> tuple[str, ...]:
    """Return every notice of a diagnosis; known: effects of the model, which need none."""
    experiment, search = outcome.experiment, outcome.search
    space, model = search.density.space, selected.point.own.model_at(selected.point.constants)

    def predict(record: Record) -> Array:
        return space.forces(selected.hypothesis, selected.point.constants[None], record)[0]

    every, named_offset = len(outcome.weights), ContactOffset.name in decision.tried
    not_counted = [
        (outcome.without_evidence, "left out of the decision: their evidence is not a finite"
         " number"),
        (len(outcome.unpredicted), "predict no finite force at some samples, which counts as zero"
         " force"),
    ]  # fmt: skip
    early = (
        f"the search ended after {len(search.modes)} hypotheses, because very many fit alike: "
        "probabilities are those among these hypotheses"
    )
    of_tests = (
        *experiment.floor.notices,
        *unresolved_times(model.relaxation, experiment.scales),
        *([early] if search.ended_early else ()),
    )
    pad = f"pad {experiment.pad}: "
    return (
        *experiment.notices,
        *pull_notices(experiment, bonded=space.bonded, effects=known),
        *(pad + text for text in unlikely_over_all(outcome, decision)),
        *(pad + text for text in _alike(outcome, decision)),
        *(contact_notices(experiment, outcome.estimates(selected)) if named_offset else ()),
        *(f"{pad}{n} of {every} hypotheses {what}" for n, what in not_counted if n),
        *carryover_notices(experiment, experiment.trials, space.record, predict),
        *(pad + text for text in of_tests),
    )


def unlikely_over_all(outcome: SearchOutcome, decision: Decision) -> list[str]:
    """Return a notice for each effect that is named only after others were refused."""
    return [
        f"{name} is named after other effects were refused "
        f"(probability {percent(decision.inclusion[name])}); over all hypotheses its "
        f"probability is {percent(outcome.inclusion(name))}"
        for name in decision.effects
        if outcome.inclusion(name) < outcome.search.settings.named
    ]


def _alike(outcome: SearchOutcome, decision: Decision) -> list[str]:
    """Return a sentence where one test that loads once leaves open what follows its depth."""
    alike = [name for name in decision.group if name in outcome.alike]
    if len(alike) < 2:
        return []
    return [
        f"{joined(alike)} all follow the largest depth so far, and no load of this one test goes "
        "deeper than its first. That one of them is there is as probable as stated; which of them, "
        "or whether the specimen yielded, depends on the elastic law. Press a fresh specimen in "
        "steps to growing depths, back after each"
    ]


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
    offsets = [kind.name for kind in by_family().get(ContactOffset.name, [])]
    for effect, gap in [(one, estimates.get(f"{one}.gap")) for one in offsets]:
        if gap is None:
            continue
        known = f"contact, which is known to {plain(error, 2)} {gap.unit}"
        says = f"agrees with the measured {known}: it corrects it, and is no other effect"
        if abs(gap.mean) > _BEYOND * np.hypot(gap.sd, error):
            says = (
                f"contradicts the measured {known}. One of the two is wrong: another effect looks "
                "like an offset, or drag, a film or a lag has moved the measured onset of the "
                "force. The option --contact states a contact where a machine's file is read"
            )
        notices.append(f"pad {experiment.pad}: {effect} of {gap} {says}")
    return tuple(notices)
