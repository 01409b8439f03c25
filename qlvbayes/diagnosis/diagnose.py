"""The whole diagnosis of one pad: gate, search, adequacy, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from qlvbayes.checks import InputError
from qlvbayes.choices import Choices
from qlvbayes.diagnosis.adequacy import Adequacy, adequacy
from qlvbayes.diagnosis.ahead import compile_ahead
from qlvbayes.diagnosis.averaging import averaged
from qlvbayes.diagnosis.contest import Contender
from qlvbayes.diagnosis.design import Suggestion, suggest
from qlvbayes.diagnosis.evidence import laplace_check
from qlvbayes.diagnosis.formsearch import Found, other_forms, step_of
from qlvbayes.diagnosis.freespring import FreeSpring
from qlvbayes.diagnosis.gate import bends, coincident, unseen
from qlvbayes.diagnosis.protocol import protocol_of
from qlvbayes.diagnosis.samples import Samples, cell_errors, rmse
from qlvbayes.diagnosis.search import Path, Step, Tell, search
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.swap import rivals, settle
from qlvbayes.diagnosis.verdict import Diagnosis, Estimate, Ranked, Sampled, Stage, Work
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.subset import Ensemble, with_every_effect
from qlvbayes.noise import AbstractGaussian
from qlvbayes.posterior import Posterior
from qlvbayes.runtime import forget_compiled

EVIDENCES = ("laplace", "nested")
COSTLY = ("frame_compliance", "channel_lag")  # they run the law beneath several times


def diagnose(
    experiment: Experiment,
    choices: Choices | None = None,
    *,
    kinds: Sequence[type[AbstractEffect]] = EFFECTS,
    settings: Settings | None = None,
    evidence: str = "laplace",
    seed: int = 0,
    tell: Tell = lambda text: None,
) -> Diagnosis:
    """Say which effect of ``kinds`` the model of ``choices`` lacks, from all tests together.

    evidence: ``nested`` samples ``none`` and the two best hypotheses again by nested sampling, a
    minute or two each. ``tell`` hears what is being done. Raises InputError where the noise model
    is not Gaussian.
    """
    settings = settings or Settings()
    choices = choices or Choices()
    forget_compiled()
    ensemble = _ensemble(experiment, choices, kinds)
    samples = Samples.of(experiment, ensemble)
    protocol = protocol_of(experiment, bonded=choices.bonded)
    candidates = ensemble.candidates
    tell("compiling")
    compile_ahead(ensemble, samples)
    path = search(ensemble, samples, candidates, settings, tell)
    if adequacy(experiment, ensemble, path.last.point).p_value >= settings.false_alarms:
        settle(ensemble, samples, path, candidates, settings, tell)
    tell("testing what is left")
    plain, scores = path.rounds[0].base, path.rounds[0].scores
    adequacies = [adequacy(experiment, ensemble, step.point) for step in path.steps]
    alike = _alike(experiment, ensemble, path, settings)
    group = tuple(contender.effect for contender in alike)
    sound = adequacies[-1].p_value >= settings.false_alarms
    forms = other_forms(experiment, ensemble, path, sound, settings)
    explanations = [(c.log_bayes_factor, c.point) for c in alike if c.point is not None]
    if forms:
        tell("trying other forms of the effects")
        explanations = [(f.point.log_evidence, f.point) for f in forms]
        alike, group = [], tuple(dict.fromkeys(found.form.effect for found in forms))
        path, adequacies = _in_other_form(path, adequacies, forms[0], samples)
    spring = _spring(experiment, ensemble, path)
    verdict = _verdict(path, adequacies[-1], group, spring, settings)
    named = _named(path, group) if verdict in ("missing_effect", "ambiguous") else ()
    work = Work(experiment, ensemble, samples, path, tuple(adequacies))
    sampled = _nested(ensemble, path, seed, tell) if evidence == "nested" else ()
    return Diagnosis(
        pad=experiment.pad,
        noise=experiment.floor.total,
        verdict=verdict,
        effects=named,
        group=group if named else (),
        stages=tuple(_stage(work, k, settings) for k in range(len(path.steps))),
        ranking=_ranking(work, settings),
        not_identifiable=tuple(unseen(ensemble, plain, scores, protocol)),
        bends=tuple(bends(ensemble, plain, scores)),
        coincident=tuple(coincident(ensemble, plain, scores)),
        refused=tuple(path.refused),
        warnings=(*_warnings(ensemble, path), *_disagreements(sampled)),
        suggestions=_suggestions(experiment, ensemble, alike),
        work=work,
        nested=sampled,
        spring=spring,
        constants=_constants(work, explanations if verdict == "ambiguous" else []),
    )


def _nested(ensemble: Ensemble, path: Path, seed: int, tell: Tell) -> tuple[Sampled, ...]:
    # here, as few ask for it and blackjax is slow to import
    from qlvbayes.diagnosis.nested_check import nested_check

    found = nested_check(ensemble, path.rounds[0], seed=seed, tell=tell)
    return tuple(Sampled(c.effect, c.laplace, c.log_evidence, c.error) for c in found)


def _disagreements(sampled: tuple[Sampled, ...]) -> list[str]:
    return [
        f"{s.effect}: log evidence {s.laplace:.1f} by Laplace, {s.log_evidence:.1f} +- "
        f"{s.error:.1f} by nested sampling"
        for s in sampled
        if not s.agrees
    ]


def _ensemble(
    experiment: Experiment, choices: Choices, kinds: Sequence[type[AbstractEffect]]
) -> Ensemble:
    scales = experiment.scales
    model, noise = choices.build(scales)
    if not isinstance(noise, AbstractGaussian):
        raise InputError(
            "the diagnosis needs normal noise", remedy="use --noise correlated or --noise white"
        )
    posterior = Posterior(model, noise, experiment.record(experiment.trials))
    own = [effect.name for effect in model.effects]
    added = tuple(
        kind.default(scales)
        for kind in kinds
        if kind.name not in own and not (choices.bonded and kind.name == "adhesion")
    )
    return with_every_effect(posterior, added, COSTLY)


def _alike(
    experiment: Experiment, ensemble: Ensemble, path: Path, settings: Settings
) -> list[Contender]:
    """Effects that may stand in one's place: as likely, and leaving nothing structured."""

    def sound(contender: Contender) -> bool:
        point = contender.point
        return (
            point is not None
            and adequacy(experiment, ensemble, point).p_value >= settings.false_alarms
        )

    near = rivals(path, settings)
    return [c for k, c in enumerate(near) if k == 0 or sound(c)]


def _in_other_form(
    path: Path, adequacies: list[Adequacy], found: Found, samples: Samples
) -> tuple[Path, list[Adequacy]]:
    """The way to a model with an effect in another form."""
    kept = 1
    for k, step in enumerate(path.steps):
        if set(step.effects) <= set(found.effects):
            kept = k + 1
    steps = [*path.steps[:kept], step_of(found, samples)]
    return Path(steps, path.rounds[:kept], path.refused), [*adequacies[:kept], found.adequacy]


def _named(path: Path, group: tuple[str, ...]) -> tuple[str, ...]:
    """Effects of the last model; one that has rivals comes last."""
    if len(group) < 2:
        return path.last.effects
    return (*(effect for effect in path.last.effects if effect != group[0]), group[0])


def _spring(experiment: Experiment, ensemble: Ensemble, path: Path) -> float | None:
    """Log Bayes factor of a spring of free form against the effects found; None without effects."""
    if not path.last.effects:
        return None
    spring = FreeSpring(experiment, ensemble, ensemble.subset()).fit(path.steps[0].point)
    return float(spring.log_evidence - path.last.point.log_evidence)


def _verdict(
    path: Path, last: Adequacy, group: tuple[str, ...], spring: float | None, settings: Settings
) -> str:
    if last.p_value < settings.false_alarms or (spring or 0.0) > settings.spring:
        return "unexplained"
    if not path.last.effects:
        return "adequate"
    return "ambiguous" if len(group) > 1 else "missing_effect"


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
    level = 0.5 * settings.false_alarms / len(tested.cells)  # the other half is the noise's
    return Stage(
        effects=step.effects,
        rmse=step.rmse,
        heldout_rmse=step.heldout.rmse,
        log_evidence=float(step.point.log_evidence),
        p_value=tested.p_value,
        noise_p_value=tested.noise_p_value,
        sound=tested.p_value >= settings.false_alarms,
        cells=tuple(cell_errors(work.samples, step.residuals)),
        failing=tuple((c.test, c.phase) for c in tested.cells if c.p_value < level),
        parameters=_estimates(work, step.point, _is_of_pad),
        shape=step.form.shape(step.point) if step.form else None,
    )


def _constants(work: Work, alike: list[tuple[float, Point]]) -> dict[str, Estimate]:
    """The plain model's, by the last model; averaged where several (evidence, fit) are alike."""
    logs, points = zip(*(alike or [(0.0, work.path.last.point)]), strict=True)
    return averaged(logs, [_estimates(work, point, _is_plain) for point in points])


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
    sds = np.sqrt(np.maximum(np.diag(point.constants_covariance), 0.0))
    return {
        ensemble.names[k]: Estimate(
            work.experiment.units.of(kinds[k]), float(point.constants[k]), float(sds[k])
        )
        for k in point.subset.constants
        if wanted(ensemble.names[k])
    }
