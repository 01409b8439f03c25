"""From a finished search to all that is told of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from qlvbayes.diagnosis.certainty import certainty
from qlvbayes.diagnosis.checks.outcome import LEAST, Outcome
from qlvbayes.diagnosis.checks.sensitivity import (
    coincident,
    parameter_biases,
    responses,
    unmeasured,
    unseen,
)
from qlvbayes.diagnosis.checks.vetoes import decided
from qlvbayes.diagnosis.decision import Decision
from qlvbayes.diagnosis.nexttest.suggest import suggest
from qlvbayes.diagnosis.protocol import protocol_of
from qlvbayes.diagnosis.result import (
    Base,
    Checked,
    DiagnosisResult,
    Ranked,
    Refused,
    Stage,
    Suggestion,
    Worst,
)
from qlvbayes.diagnosis.search import Search, Tell
from qlvbayes.diagnosis.telling.verdict import Diagnosis
from qlvbayes.diagnosis.telling.work import Work
from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.io.wording import percent
from qlvbayes.laws.resolution import unresolved_times
from qlvbayes.motion.carryover import carryover_notices, clock_notices
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.record import Record

Array = NDArray[np.float64]


def summed_up(
    experiment: Experiment,
    search: Search,
    kinds: Sequence[type[AbstractEffect]],
    bonded: bool,
    tell: Tell,
) -> Diagnosis:
    """All that is told of a finished search."""
    outcome = Outcome(experiment, search)
    decision, refused = decided(outcome, tell)
    told = outcome.seen[decision.told]
    path = _path(search, told)
    tell("what these tests cannot show")
    plain = search.modes[search.usual][0]
    protocol = protocol_of(experiment, bonded=bonded, settings=search.settings)
    added = responses(search, plain)
    bases = tuple(Base(*laws, share) for laws, share in decision.base.items() if share >= LEAST)
    own = told.hypothesis.base
    candidates = [kind for kind in kinds if kind.name not in search.usual.effects]
    stages = tuple(outcome.stage(one) for one in path)
    left, worst = outcome.left(told), stages[0].worst
    result = DiagnosisResult(
        pad=experiment.pad,
        units=experiment.units,
        noise=experiment.floor.total,
        verdict=decision.verdict,
        effects=decision.tried,
        group=decision.group,
        forms=_forms(search, told, decision),
        base=Base(*own, decision.base[own]),
        bases=bases,
        outside=decision.outside,
        alternatives=outcome.alternatives(),
        not_ruled_out=outcome.sets() if decision.verdict != "unexplained" else (),
        constants=outcome.constants(told),
        heldout_of_all=outcome.heldout_of_all(),
        stages=stages,
        ranking=_with_certainty(outcome.ranking(), stages, experiment.floor.total),
        not_identifiable=(
            *unseen(added, search, protocol),
            *unmeasured(candidates, protocol),
        ),
        biases=tuple(parameter_biases(added, plain)),
        coincident=tuple(coincident(added)),
        refused=tuple(Refused(name, why) for name, why in refused),
        notices=(
            *unlikely_over_all(outcome, decision),
            *_not_counted(outcome),
            *_notices(experiment, search, told),
        ),
        suggestions=_suggestions(outcome, decision),
        checks=tuple(Checked(name, **vars(one)) for name, one in search.checks.items()),
        discrepancy=told.mode.size,
        tolerance=left.tolerance,
        remainder=left.told,
        worst=Worst(worst.test, worst.phase, worst.rmse, worst.bias),
    )
    adequacies = tuple(outcome.tested(one) for one in path)
    return Diagnosis(result, Work(experiment, search, outcome.samples, path, adequacies))


def _with_certainty(
    ranking: Sequence[Ranked], stages: Sequence[Stage], noise: float
) -> tuple[Ranked, ...]:
    """Each effect with how often one with such evidence was there in blind studies."""
    return tuple(
        structs.replace(
            one,
            certainty=None
            if one.effect == "none"
            else certainty(one.effect, one.inclusion, one.log_bayes_factor, stages, noise),
        )
        for one in ranking
    )


def _forms(search: Search, told: Weighed, decision: Decision) -> dict[str, str]:
    """Members of families that stand for an effect named, where that is not the listed law."""
    own = search.families.named(told.hypothesis.effects)
    return {name: own[name] for name in decision.tried if own.get(name, name) != name}


def _path(search: Search, told: Weighed) -> tuple[Weighed, ...]:
    """From the plain model that was chosen, by the told one's laws, effect after effect."""
    hypothesis = replace(told.hypothesis, effects=search.usual.effects)
    search.see(hypothesis)
    steps = [search.usual, hypothesis]
    left = set(search.added(told.hypothesis))
    while len(left) > 1:
        for name in left:
            search.see(steps[-1].plus(name), told.hypothesis)
        best = max(left, key=lambda name: search.log_posterior(steps[-1].plus(name)))
        steps.append(steps[-1].plus(best))
        left.remove(best)
    steps.append(told.hypothesis)
    known = [one for one in dict.fromkeys(steps) if one in search.modes]
    return tuple(search.modes[one][0] for one in known)


def _suggestions(outcome: Outcome, decision: Decision) -> tuple[Suggestion, ...]:
    """Tests that would tell the members of a group apart."""
    rest = set(decision.effects)
    points = []
    for name in decision.group:
        same = [
            (weight.log_posterior, k)
            for k, weight in enumerate(outcome.weights)
            if weight.effects == rest | {name}
        ]
        if same:
            points.append(outcome.seen[max(same)[1]])
    found = suggest(outcome.experiment, outcome.search.density, points) if len(points) > 1 else []
    return tuple(found)


def unlikely_over_all(outcome: Outcome, decision: Decision) -> list[str]:
    """Effects that are named only after a veto: over all hypotheses they are not as likely."""
    return [
        f"pad {outcome.experiment.pad}: {name} is named after other effects were refused "
        f"(probability {percent(decision.inclusion[name])}); over all hypotheses its "
        f"probability is {percent(outcome.inclusion(name))}"
        for name in decision.effects
        if outcome.inclusion(name) < outcome.search.settings.named
    ]


def _not_counted(outcome: Outcome) -> list[str]:
    """How many hypotheses take no part in the decision, or predict no number somewhere."""
    every, said = f"of {len(outcome.weights)} hypotheses", []
    if count := sum(not weight.counts for weight in outcome.weights):
        said.append(
            f"{count} {every} left out of the decision: their evidence is not a finite number"
        )
    if count := len(outcome.unpredicted):
        said.append(
            f"{count} {every} predict no finite force at some samples, which counts as zero force"
        )
    return [f"pad {outcome.experiment.pad}: {text}" for text in said]


def _notices(experiment: Experiment, search: Search, told: Weighed) -> tuple[str, ...]:
    """What the tests have from each other, by the hypothesis told."""
    space = search.density.space
    constants = told.point.constants

    def predict(record: Record) -> Array:
        return space.forces(told.hypothesis, constants[None], record)[0]

    carried = carryover_notices(experiment, experiment.trials, space.record, predict)
    clock = () if experiment.rested else clock_notices(experiment)
    model = told.point.own.posterior.with_constants(jnp.asarray(constants))[0]
    times = unresolved_times(model.relaxation, experiment.scales)
    said = [f"pad {experiment.pad}: {text}" for text in (*experiment.floor.notices, *times)]
    if search.ended_early:
        said.append(
            f"pad {experiment.pad}: the search ended after {len(search.modes)} hypotheses, because "
            "very many fit alike: probabilities are those among these hypotheses"
        )
    return (*carried, *clock, *said)
