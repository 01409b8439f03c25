"""Where no sum of the list's laws will do, one of its effects in a form of its own may."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.adequacy import Adequacy, adequacy_along, whitened_vectors
from qlvbayes.diagnosis.heldout import form_held_out
from qlvbayes.diagnosis.otherform import OtherForm
from qlvbayes.diagnosis.ownforms import OWN_FORMS
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, Step
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point, climb, noise_along, predict_along
from qlvbayes.inference.subset import Ensemble
from qlvbayes.inference.together import together

_FIRST = 3  # contenders of the first round that are tried
Model = tuple[tuple[str, ...], Point]  # its effects, its optimum
Attempt = tuple[OtherForm, tuple[str, ...], Point]  # and what it starts from
_LEAST = -0.1  # of the largest factor: below, the effect would turn into its opposite


@dataclass(frozen=True, eq=False)
class Found:
    """A model with one effect in another form.

    before: its optimum in the list's own form.
    """

    form: OtherForm
    effects: tuple[str, ...]
    before: Point
    point: Point
    adequacy: Adequacy


def other_forms(
    experiment: Experiment, ensemble: Ensemble, path: Path, sound: bool, settings: Settings
) -> list[Found]:
    """Models with one of their effects in another form, each adequate and about as likely.

    Best first. Tried are the steps on the way, the fewest effects first, then the best other
    contenders of the first round, side by side: the first turn of which one will do is taken, as an
    effect free in its form can imitate others. Where the last step is ``sound``, only steps with
    fewer effects are tried, and they must beat it.
    """
    least = path.last.point.log_evidence + settings.further if sound else -np.inf

    def attempt(one: Attempt) -> Found | None:
        found = _try(*one)
        better = _stands(found, settings) and found.point.log_evidence > least
        return found if better and resembles(found, settings) else None

    for models in _turns(path, sound):
        attempts = [one for model in models for one in _forms(experiment, ensemble, *model)]
        good = [found for found in together(attempt, attempts) if found is not None]
        if good:
            best = max(found.point.log_evidence for found in good)
            near = [f for f in good if f.point.log_evidence > best - settings.apart]
            return sorted(near, key=lambda found: -found.point.log_evidence)
    return []


def _turns(path: Path, sound: bool) -> list[list[Model]]:
    """Models that are tried together, one list after the other."""
    found = path.steps[1 : -1 if sound else None]
    steps: list[Model] = sorted(((step.effects, step.point) for step in found), key=_count)
    known = [effects for effects, _ in steps]
    first = path.rounds[0].contenders
    if sound:
        refused = {name for name, _ in path.refused} if not path.last.effects else set()
        first = tuple(contender for contender in first if contender.effect in refused)
    others: list[Model] = [
        ((contender.effect,), contender.point)
        for contender in first[:_FIRST]
        if contender.point is not None and (contender.effect,) not in known
    ]
    return [*([step] for step in steps), others]


def _forms(
    experiment: Experiment, ensemble: Ensemble, effects: tuple[str, ...], point: Point
) -> Iterator[Attempt]:
    """Each effect of a model in another form, and in that which it is known for."""
    for effect in effects:
        if not ensemble.effect(effect).reshapes:
            continue
        yield OtherForm(experiment, ensemble, point.subset, effect), effects, point
        if effect in OWN_FORMS:
            own, rest = OWN_FORMS[effect], tuple(name for name in effects if name != effect)
            subset = ensemble.subset(rest) if own.replaces else point.subset
            yield own(experiment, ensemble, subset, effect), effects, point


def _count(model: Model) -> int:
    return len(model[0])


def _try(form: OtherForm, effects: tuple[str, ...], point: Point) -> Found:
    best = form.fit(point)
    left = adequacy_along(form.experiment, form.ensemble, best, *form.along(best))
    return Found(form, effects, point, best, left)


def _stands(found: Found, settings: Settings) -> bool:
    """Adequate, decisively better than the list's form, and nowhere turned into its opposite."""
    return bool(
        found.adequacy.p_value >= settings.false_alarms
        and found.point.log_evidence > found.before.log_evidence + settings.further
        and found.form.least(found.point) > _LEAST
    )


def resembles(found: Found, settings: Settings) -> bool:
    """Whether an effect in another form is still itself: known for it, or mostly the list's.

    Otherwise it is but a carrier for a factor that could stand for anything. Explained is what the
    sum of squares falls by, whitened by the noise that the other form leaves.
    """
    if found.form.is_typical(found.point):
        return True
    ensemble, before = found.form.ensemble, found.before
    rest = ensemble.subset(before.subset.effects - {found.form.effect})
    without = climb(ensemble, rest, before.theta)
    still = np.zeros((1, before.constants.size))
    models = [predict_along(ensemble, p.constants, still)[0] for p in (without, before)]
    predicted = np.stack([*models, found.form.along(found.point)[0]])
    record = ensemble.posterior.record
    noise, _ = noise_along(ensemble.posterior.noise, found.point.constants, still)
    left = whitened_vectors(noise, record, np.asarray(record.blocks.force) - predicted)
    bare, listed, other = np.sum(left**2, axis=1)
    return bool(bare - listed > settings.likeness * (bare - other))


def step_of(found: Found, samples: Samples) -> Step:
    """The model as a step, with its error on tests left out."""
    held = form_held_out(found.form, samples, found.point)
    return Step(found.effects, found.point, _residuals(found, samples), held, found.form)


def _residuals(found: Found, samples: Samples) -> list[np.ndarray]:
    predicted = found.form.predict(samples, [found.point])[0]
    return [one - two for one, two in zip(samples.observed, predicted, strict=True)]
