"""Judging what the search came to: is structure left, would another effect or form do as well."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.adequacy import Adequacy, adequacy, is_sound
from qlvbayes.diagnosis.averaging import explanations_of
from qlvbayes.diagnosis.contest import Contender
from qlvbayes.diagnosis.forms.search import other_forms
from qlvbayes.diagnosis.freespring import FreeSpring
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, Step, Tell
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.swap import rivals
from qlvbayes.diagnosis.verdict import Work
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.subset import Ensemble


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict and what it rests on.

    alike: contenders that the suggested tests are to tell apart; explanations: log weight and
    optimum of each model that the tests do not rule out.
    """

    work: Work
    verdict: str
    group: tuple[str, ...]
    spring: float | None
    alike: list[Contender]
    explanations: list[tuple[float, Point]]


def judged(
    experiment: Experiment,
    ensemble: Ensemble,
    samples: Samples,
    path: Path,
    settings: Settings,
    tell: Tell,
) -> Judged:
    """Judge the last model of the search."""
    adequacies = [adequacy(experiment, ensemble, step.point) for step in path.steps]
    alike = _alike(experiment, ensemble, path, settings)
    group = tuple(contender.effect for contender in alike)
    sound = adequacies[-1].is_sound(settings)
    tell("trying other forms of the effects")
    step, forms = other_forms(experiment, ensemble, samples, path, sound, settings)
    if step is None:
        explanations = explanations_of(experiment, ensemble, path, settings)
    else:
        alike, group = [], tuple(dict.fromkeys(found.form.effect for found in forms))
        explanations = [(found.point.log_evidence, found.point) for found in forms]
        path, adequacies = _in_other_form(path, adequacies, step, forms[0].adequacy)
    spring = _spring(experiment, ensemble, path)
    verdict = _verdict(path, adequacies[-1], group, spring, settings)
    work = Work(experiment, ensemble, samples, path, tuple(adequacies))
    return Judged(work, verdict, group, spring, alike, explanations)


def _alike(
    experiment: Experiment, ensemble: Ensemble, path: Path, settings: Settings
) -> list[Contender]:
    """Effects that may stand in one's place: as likely, and leaving nothing structured."""
    near = rivals(path, settings)
    return [
        c for k, c in enumerate(near) if k == 0 or is_sound(experiment, ensemble, c.point, settings)
    ]


def _in_other_form(
    path: Path, adequacies: list[Adequacy], last: Step, adequate: Adequacy
) -> tuple[Path, list[Adequacy]]:
    """The way to a model with an effect in another form."""
    kept = 1
    for k, step in enumerate(path.steps):
        if set(step.effects) <= set(last.effects):
            kept = k + 1
    steps = [*path.steps[:kept], last]
    return Path(steps, path.rounds[:kept], path.refused), [*adequacies[:kept], adequate]


def _spring(experiment: Experiment, ensemble: Ensemble, path: Path) -> float | None:
    """Log Bayes factor of a spring of free form against the effects found; None without effects."""
    if not path.last.effects:
        return None
    spring = FreeSpring(experiment, ensemble, ensemble.subset()).fit(path.steps[0].point)
    return float(spring.log_evidence - path.last.point.log_evidence)


def _verdict(
    path: Path, last: Adequacy, group: tuple[str, ...], spring: float | None, settings: Settings
) -> str:
    if not last.is_sound(settings) or (spring or 0.0) > settings.spring:
        return "unexplained"
    if not path.last.effects:
        return "adequate"
    return "ambiguous" if len(group) > 1 else "missing_effect"
