"""Where no sum of the list's laws will do, one of its effects in a form of its own may."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from qlvbayes.diagnosis.adequacy import Adequacy, adequacy_along
from qlvbayes.diagnosis.heldout import form_held_out
from qlvbayes.diagnosis.otherform import GradualContact, OtherForm
from qlvbayes.diagnosis.samples import Samples, rmse
from qlvbayes.diagnosis.search import Path, Step
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.effects.contact_offset import ContactOffset
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble
from qlvbayes.inference.together import together

_FIRST = 3  # contenders of the first round that are tried
Model = tuple[tuple[str, ...], Point]  # its effects, its optimum
_LEAST = -0.1  # factor below which the effect would turn into its opposite


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
    experiment: Experiment, samples: Samples, path: Path, sound: bool, settings: Settings
) -> list[Found]:
    """One model with one of its effects in another form, each that is adequate, best first.

    Tried are the steps on the way, the fewest effects first, then the best other contenders of the
    first round: the first that will do is taken, as an effect free in its form can imitate others.
    Where the last step is ``sound``, only steps with fewer effects are tried, and they must beat
    it.
    """
    ensemble = samples.ensemble
    least = path.last.point.log_evidence + settings.further if sound else -np.inf
    steps = [(step.effects, step.point) for step in path.steps[1 : -1 if sound else None]]
    others: list[Model] = [
        ((contender.effect,), contender.point)
        for contender in path.rounds[0].contenders[: 0 if sound else _FIRST]
        if contender.point is not None and (contender.effect,) not in [e for e, _ in steps]
    ]
    turns = [*sorted(steps, key=_count), *others]
    for effects, point in turns:
        forms = _forms(experiment, ensemble, effects, point)
        tried = together(partial(_try, effects=effects, point=point), forms)
        good = [f for f in tried if _stands(f, settings) and f.point.log_evidence > least]
        good = [f for f in good if resembles(f, samples, settings)]
        if good:
            return sorted(good, key=lambda found: -found.point.log_evidence)
    return []


def _forms(
    experiment: Experiment, ensemble: Ensemble, effects: tuple[str, ...], point: Point
) -> Iterator[OtherForm]:
    """Each effect of a model in another form."""
    for effect in effects:
        yield OtherForm(experiment, ensemble, point.subset, effect)
        if effect == ContactOffset.name:
            rest = tuple(name for name in effects if name != effect)
            yield GradualContact(experiment, ensemble, ensemble.subset(rest), effect)


def _count(model: Model) -> int:
    return len(model[0])


def _try(form: OtherForm, effects: tuple[str, ...], point: Point) -> Found:
    best = form.fit(point)
    left = adequacy_along(form.experiment, form.ensemble, best, *form.along(best))
    return Found(form, effects, point, best, left)


def _stands(found: Found, settings: Settings) -> bool:
    """Adequate, decisively better than the list's form, and nowhere turned into its opposite."""
    _, coefficients = found.form.split(found.point.theta)
    factor = 1.0 + np.tensordot(coefficients, found.form.at_blocks, 1)
    real = np.asarray(found.form.ensemble.posterior.record.blocks.real)
    return bool(
        found.adequacy.p_value >= settings.false_alarms
        and found.point.log_evidence > found.before.log_evidence + settings.further
        and factor[real].min() > _LEAST
    )


def resembles(found: Found, samples: Samples, settings: Settings) -> bool:
    """Whether the list's form explains most of what the other form does.

    Otherwise the effect is but a carrier for a factor that could stand for anything.
    """
    ensemble, before = found.form.ensemble, found.before
    rest = ensemble.subset(before.subset.effects - {found.form.effect})
    without = climb(ensemble, rest, before.theta)
    bare, listed = (rmse(samples.residuals(p.constants)) ** 2 for p in (without, before))
    other = rmse(_residuals(found, samples)) ** 2
    return bool(bare - listed > settings.likeness * (bare - other))


def step_of(found: Found, samples: Samples) -> Step:
    """The model as a step, with its error on tests left out."""
    held = form_held_out(found.form, samples, found.point)
    return Step(found.effects, found.point, _residuals(found, samples), held, found.form)


def _residuals(found: Found, samples: Samples) -> list[np.ndarray]:
    predicted = found.form.predict(samples, [found.point])[0]
    return [one - two for one, two in zip(samples.observed, predicted, strict=True)]
