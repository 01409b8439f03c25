"""Judging what the search came to: is structure left, would another effect or form do as well."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.diagnosis.adequacy import Adequacy, adequacy, is_sound
from qlvbayes.diagnosis.averaging import Explanation, explanations_of
from qlvbayes.diagnosis.contest import Contender
from qlvbayes.diagnosis.forms.search import Found, other_forms
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, Step, Tell
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.swap import rivals
from qlvbayes.diagnosis.unlisted import against_unlisted
from qlvbayes.diagnosis.verdict import Work
from qlvbayes.experiment import Experiment
from qlvbayes.inference.subset import Ensemble


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict and what it rests on.

    unlisted: log Bayes factors of rivals that no list holds against the last model; alike:
    contenders that the suggested tests are to tell apart; explanations: models that the tests do
    not rule out, none where nothing explains them.
    """

    work: Work
    verdict: str
    group: tuple[str, ...]
    unlisted: dict[str, float]
    alike: list[Contender]
    explanations: list[Explanation]


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
    unlisted = _unlisted(experiment, ensemble, path, adequacies[-1].is_sound(settings))
    sound = _explains(adequacies[-1], unlisted, settings)
    tell("trying other forms of the effects")
    step, forms = other_forms(experiment, ensemble, samples, path, sound, settings)
    if step is not None:
        alike, group = [], tuple(dict.fromkeys(found.form.effect for found in forms))
        path, adequacies = _in_other_form(path, adequacies, step, forms[0].adequacy)
        unlisted = _unlisted(experiment, ensemble, path, sound=True)
    verdict = _verdict(path, _explains(adequacies[-1], unlisted, settings), group)
    explanations: list[Explanation] = []
    if verdict != "unexplained":
        explanations = _as_explanations(forms) or explanations_of(
            experiment, ensemble, path, settings
        )
    work = Work(experiment, ensemble, samples, path, tuple(adequacies))
    return Judged(work, verdict, group, unlisted, alike, explanations)


def _alike(
    experiment: Experiment, ensemble: Ensemble, path: Path, settings: Settings
) -> list[Contender]:
    """Effects that may stand in one's place: as likely, and leaving nothing structured."""
    near = rivals(path, settings)
    return [
        c for k, c in enumerate(near) if k == 0 or is_sound(experiment, ensemble, c.point, settings)
    ]


def _as_explanations(forms: list[Found]) -> list[Explanation]:
    """Models with an effect in another form, by their evidence against the best, which is first."""
    gains = [float(f.point.log_evidence - forms[0].point.log_evidence) for f in forms]
    return [Explanation(f.effects, gain, f.point) for f, gain in zip(forms, gains, strict=True)]


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


def _unlisted(
    experiment: Experiment, ensemble: Ensemble, path: Path, sound: bool
) -> dict[str, float]:
    """Log Bayes factors of what no list holds against the effects found; none if none is needed."""
    if sound and not path.last.effects:
        return {}
    plain, found = path.steps[0].point, path.last.point.log_evidence
    return against_unlisted(experiment, ensemble, plain, found)


def _explains(last: Adequacy, unlisted: dict[str, float], settings: Settings) -> bool:
    """Whether a model leaves nothing structured, and does not only imitate."""
    return last.is_sound(settings) and max(unlisted.values(), default=0.0) <= settings.unlisted


def _verdict(path: Path, explained: bool, group: tuple[str, ...]) -> str:
    if not explained:
        return "unexplained"
    if not path.last.effects:
        return "adequate"
    return "ambiguous" if len(group) > 1 else "missing_effect"
