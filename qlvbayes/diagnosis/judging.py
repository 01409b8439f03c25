"""Judging what the search came to: is structure left, would another effect or form do as well."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from qlvbayes.diagnosis.adequacy import Adequacy, adequacy, is_sound
from qlvbayes.diagnosis.averaging import Explanation, explanations_of
from qlvbayes.diagnosis.contest import Contender
from qlvbayes.diagnosis.forms.search import Found, other_forms
from qlvbayes.diagnosis.remainder import Remainder, leaves_little, remainder
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, Step, Tell
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.swap import rivals
from qlvbayes.diagnosis.unlisted import against_unlisted
from qlvbayes.diagnosis.verdict import Work
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.subset import Ensemble


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict and what it rests on.

    unlisted: log Bayes factors of rivals that no list holds against the last model; alike:
    contenders that the suggested tests are to tell apart; explanations: models that the tests do
    not rule out, none where nothing explains them; remainder: the size of what the last model
    leaves.
    """

    work: Work
    verdict: str
    group: tuple[str, ...]
    unlisted: dict[str, float]
    alike: list[Contender]
    explanations: list[Explanation]
    remainder: Remainder


def judged(
    experiment: Experiment,
    ensemble: Ensemble,
    samples: Samples,
    path: Path,
    settings: Settings,
    tell: Tell,
) -> Judged:
    """Judge the last model of the search.

    Other forms of its effects may explain structure of any size; what is left in the end does not
    count where it is small.
    """
    adequacies = [adequacy(experiment, ensemble, step.point) for step in path.steps]
    sound = adequacies[-1].is_sound(settings)
    enough = _standard(experiment, ensemble, samples, sound, settings)
    alike = [c for k, c in enumerate(rivals(path, settings)) if k == 0 or enough(c.point)]
    group = tuple(contender.effect for contender in alike)
    unlisted = _unlisted(experiment, ensemble, path, sound)
    sound = _explains(adequacies[-1], unlisted, settings)
    tell("trying other forms of the effects")
    step, forms = other_forms(experiment, ensemble, samples, path, sound, settings)
    if step is not None:
        alike, group = [], tuple(dict.fromkeys(found.form.effect for found in forms))
        path, adequacies = _in_other_form(path, adequacies, step, forms[0].adequacy)
        unlisted = _unlisted(experiment, ensemble, path, sound=True)
    left = _remainder(experiment, samples, path, adequacies[-1], settings)
    explained = _explains(adequacies[-1], unlisted, settings, left)
    verdict = _verdict(path, explained or _is_plain_and_little(path, left), group)
    explanations: list[Explanation] = []
    if verdict != "unexplained":
        explanations = _as_explanations(forms) or explanations_of(
            experiment, ensemble, path, settings, enough
        )
    work = Work(experiment, ensemble, samples, path, tuple(adequacies))
    return Judged(work, verdict, group, unlisted, alike, explanations, left)


def _standard(
    experiment: Experiment,
    ensemble: Ensemble,
    samples: Samples,
    sound: bool,
    settings: Settings,
) -> Callable[[Point | None], bool]:
    """What another model may leave to be as good as the last one: no more than that."""
    if sound:
        return lambda point: is_sound(experiment, ensemble, point, settings)
    return lambda point: leaves_little(experiment, ensemble, samples, point, settings)


def _remainder(
    experiment: Experiment, samples: Samples, path: Path, last: Adequacy, settings: Settings
) -> Remainder:
    """Size of what the last model leaves."""
    left, plain = path.last.residuals, path.steps[0].residuals
    peak = experiment.scales.force
    return remainder(samples, left, last, plain, peak=peak, settings=settings)


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


def _explains(
    last: Adequacy,
    unlisted: dict[str, float],
    settings: Settings,
    left: Remainder | None = None,
) -> bool:
    """Whether a model leaves nothing structured, and does not only imitate.

    left: its size, where structure that is small does not count.
    """
    sound = last.is_sound(settings) or (left is not None and left.is_small)
    return sound and max(unlisted.values(), default=0.0) <= settings.unlisted


def _is_plain_and_little(path: Path, left: Remainder) -> bool:
    """Whether there is no effect that could only imitate, and little that a rival explains."""
    return not path.last.effects and left.is_small


def _verdict(path: Path, explained: bool, group: tuple[str, ...]) -> str:
    if not explained:
        return "unexplained"
    if not path.last.effects:
        return "adequate"
    return "ambiguous" if len(group) > 1 else "missing_effect"
