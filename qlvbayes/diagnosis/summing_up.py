"""All that a diagnosis tells: stages, ranking, constants, what these tests cannot see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import numpy as np
from scipy.special import softmax

from qlvbayes.carried import carried_notices, clock_notices
from qlvbayes.diagnosis.averaging import Explanation, averaged
from qlvbayes.diagnosis.contest import Contender
from qlvbayes.diagnosis.design import Suggestion, suggest
from qlvbayes.diagnosis.evidence import laplace_check
from qlvbayes.diagnosis.gate import bends, coincident, unmeasured, unseen
from qlvbayes.diagnosis.judging import Judged
from qlvbayes.diagnosis.samples import cell_errors, rmse
from qlvbayes.diagnosis.search import Path, Step
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.verdict import (
    Diagnosis,
    Estimate,
    NotRuledOut,
    Ranked,
    Sampled,
    Stage,
    Work,
)
from qlvbayes.effects.effect import Protocol
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point, pad_directions, predict_along
from qlvbayes.inference.subset import Ensemble
from qlvbayes.records.record import Record
from qlvbayes.unresolved import unresolved_times


def summed_up(
    judged: Judged, protocol: Protocol, sampled: tuple[Sampled, ...], settings: Settings
) -> Diagnosis:
    """All that is told of it."""
    work, verdict = judged.work, judged.verdict
    experiment, ensemble, path = work.experiment, work.ensemble, work.path
    plain, scores = path.rounds[0].base, path.rounds[0].scores
    named = _named(path, judged.group) if verdict in ("missing_effect", "ambiguous") else ()
    return Diagnosis(
        pad=experiment.pad,
        noise=experiment.floor.total,
        verdict=verdict,
        effects=named,
        group=judged.group if named else (),
        stages=tuple(_stage(work, k, settings) for k in range(len(path.steps))),
        ranking=_ranking(work, settings),
        not_identifiable=(
            *unseen(ensemble, plain, scores, protocol),
            *unmeasured(ensemble, protocol),
        ),
        bends=tuple(bends(ensemble, plain, scores)),
        coincident=tuple(coincident(ensemble, plain, scores)),
        refused=tuple(path.refused),
        warnings=(*_warnings(ensemble, path), *_disagreements(sampled)),
        suggestions=_suggestions(experiment, ensemble, judged.alike),
        work=work,
        nested=sampled,
        unlisted=judged.unlisted,
        outside=_outside(judged.unlisted, settings),
        not_ruled_out=_not_ruled_out(judged.explanations, settings),
        constants=_constants(work, judged.explanations),
        remainder=judged.remainder,
        notices=_notices(work),
    )


def _notices(work: Work) -> tuple[str, ...]:
    """What the tests have from each other, by the last model that is told."""
    experiment, ensemble = work.experiment, work.ensemble
    constants = work.path.last.point.constants

    def predict(record: Record) -> np.ndarray:
        other = Ensemble(replace(ensemble.posterior, record=record), ensemble.costly, ensemble.own)
        return predict_along(other, constants, pad_directions(np.zeros((1, constants.size))))[0]

    carried = carried_notices(experiment, experiment.trials, ensemble.posterior.record, predict)
    clock = () if experiment.rested else clock_notices(experiment)
    model = ensemble.posterior.with_constants(jnp.asarray(constants))[0]
    times = unresolved_times(model.relaxation, experiment.scales)
    said = [f"pad {experiment.pad}: {text}" for text in (*experiment.floor.notices, *times)]
    return (*carried, *clock, *said)


def _named(path: Path, group: tuple[str, ...]) -> tuple[str, ...]:
    """Effects of the last model; one that has rivals comes last."""
    if len(group) < 2:
        return path.last.effects
    return (*(effect for effect in path.last.effects if effect != group[0]), group[0])


def _disagreements(sampled: tuple[Sampled, ...]) -> list[str]:
    return [
        f"{s.effect}: log evidence {s.laplace:.1f} by Laplace, {s.log_evidence:.1f} +- "
        f"{s.error:.1f} by nested sampling"
        for s in sampled
        if not s.agrees
    ]


def _warnings(ensemble: Ensemble, path: Path) -> tuple[str, ...]:
    """Where Laplace's approximation at the last model is not to be trusted."""
    if not path.last.effects or path.last.form is not None:
        return ()
    check = laplace_check(ensemble, path.last.point)
    return tuple(f"Laplace's evidence: {reason}" for reason in check.reasons)


def _suggestions(
    experiment: Experiment, ensemble: Ensemble, alike: list[Contender]
) -> tuple[Suggestion, ...]:
    points = [contender.point for contender in alike if contender.point is not None]
    return tuple(suggest(experiment, ensemble, points)) if len(points) > 1 else ()


def _stage(work: Work, k: int, settings: Settings) -> Stage:
    step, tested = work.path.steps[k], work.adequacies[k]
    level = 0.5 * settings.false_alarms / len(tested.cells)  # the other half is all cells' together
    return Stage(
        effects=step.effects,
        rmse=step.rmse,
        heldout_rmse=step.heldout.rmse,
        log_evidence=float(step.point.log_evidence),
        p_value=tested.p_value,
        testable=tested.testable,
        sound=tested.is_sound(settings),
        cells=tuple(cell_errors(work.samples, step.residuals)),
        failing=tuple((c.test, c.phase) for c in tested.cells if c.p_value < level),
        parameters=_estimates(work, step.point, _is_of_pad),
        shape=step.form.shape(step.point) if step.form else None,
    )


def _outside(unlisted: dict[str, float], settings: Settings) -> str | None:
    """The rival that clearly beats the last model."""
    best = max(unlisted, key=lambda name: unlisted[name], default=None)
    return best if best and unlisted[best] > settings.unlisted else None


def _not_ruled_out(explanations: list[Explanation], settings: Settings) -> tuple[NotRuledOut, ...]:
    """The likeliest, best first."""
    shares = softmax([e.log_odds for e in explanations]).tolist() if explanations else []
    found = [NotRuledOut(e.effects, share) for e, share in zip(explanations, shares, strict=True)]
    return tuple(sorted(found, key=lambda one: -one.probability)[: settings.listed])


def _constants(work: Work, explanations: list[Explanation]) -> dict[str, Estimate]:
    """The plain model's, averaged over explanations, or the last model's."""
    some = explanations or [Explanation((), 0.0, work.path.last.point)]
    fitted = [_estimates(work, explanation.point, _is_plain) for explanation in some]
    return averaged([explanation.log_odds for explanation in some], fitted)


def _is_plain(name: str) -> bool:
    return "." not in name


def _starts(prefix: str, name: str) -> bool:
    return name.startswith(prefix)


def _is_of_pad(name: str) -> bool:
    return not name.startswith("noise.")


def _ranking(work: Work, settings: Settings) -> tuple[Ranked, ...]:
    first = work.path.rounds[0]
    probabilities = first.probabilities(settings)
    plain: Step = work.path.steps[0]
    ranked = [Ranked("none", probabilities["none"], 0.0, plain.rmse, {})]
    for contender in first.contenders:
        point, error, found = contender.point, None, {}
        if point is not None:
            error = rmse(work.samples.residuals(point.constants))
            own = f"{contender.effect}."
            found = _estimates(work, point, partial(_starts, own))
            found = {name.removeprefix(own): value for name, value in found.items()}
        ranked.append(
            Ranked(
                contender.effect,
                probabilities[contender.effect],
                float(contender.log_bayes_factor),
                error,
                found,
            )
        )
    return tuple(sorted(ranked, key=lambda r: -r.probability))


def _estimates(work: Work, point: Point, wanted: Callable[[str], bool]) -> dict[str, Estimate]:
    """Constants that are on at a point, by Laplace's approximation."""
    ensemble = work.ensemble
    kinds = ensemble.unit_kinds
    sds = point.constants_sds
    return {
        ensemble.names[k]: Estimate(
            work.experiment.units.of(kinds[k]), float(point.constants[k]), float(sds[k])
        )
        for k in point.subset.constants
        if wanted(ensemble.names[k])
    }
