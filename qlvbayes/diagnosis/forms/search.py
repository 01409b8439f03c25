"""Where no sum of the list's laws will do, one of its effects in a form of its own may."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.adequacy import Adequacy, adequacy_along, whitened_vectors
from qlvbayes.diagnosis.forms.otherform import AbstractOtherForm
from qlvbayes.diagnosis.forms.turns import Attempt, turns
from qlvbayes.diagnosis.heldout import form_held_out
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, Step, confirms
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point, climb, noise_along, predict_along
from qlvbayes.inference.subset import Ensemble
from qlvbayes.inference.together import together

_LEAST = -0.1  # of the largest factor: below, the effect would turn into its opposite


@dataclass(frozen=True, eq=False)
class Found:
    """A model with one effect in another form.

    before: its optimum in the list's own form.
    """

    form: AbstractOtherForm
    effects: tuple[str, ...]
    before: Point
    point: Point
    adequacy: Adequacy


def other_forms(
    experiment: Experiment,
    ensemble: Ensemble,
    samples: Samples,
    path: Path,
    sound: bool,
    settings: Settings,
) -> tuple[Step | None, list[Found]]:
    """The best model with one of its effects in another form, and those about as likely.

    Tried are the steps on the way, the fewest effects first, then the best other contenders of the
    first round, side by side: the first turn of which one will do is taken, as an effect free in
    its form can imitate others. Forms that the list's law may be far from are tried at once. Where
    the last step is ``sound``, only steps with fewer effects are, or contenders if it has none, and
    they must beat it. Left-out tests must confirm a form that does not change with the clock: one
    that does would be carried on to where nothing tells it.
    """

    def attempt(one: Attempt) -> Found | None:
        form, effects, before = one
        least = before.log_evidence + settings.form
        if sound:
            least = max(least, _least(path, effects, settings))
        best = form.highest(before, least)
        if best.log_evidence <= least or form.least(best) <= _LEAST:
            return None
        left = adequacy_along(experiment, ensemble, best, *form.along(best))
        found = Found(form, effects, before, best, left)
        good = left.is_sound(settings) and resembles(found, settings)
        return found if good else None

    for attempts in turns(experiment, ensemble, path, sound):
        good = [found for found in together(attempt, attempts) if found is not None]
        good.sort(key=lambda found: -found.point.log_evidence)
        for k, best in enumerate(good):
            step = _step_of(best, samples)
            if best.form.clocked or confirms(step, path.steps[0]):
                least = best.point.log_evidence - settings.apart
                return step, [f for f in good[k:] if f.point.log_evidence > least]
    return None, []


def _least(path: Path, effects: tuple[str, ...], settings: Settings) -> float:
    """Log evidence that effects, one in another form, must have where the last model is sound."""
    last = path.last
    more = _price(effects, settings) + settings.form - _price(last.effects, settings)
    return float(last.point.log_evidence + max(more, settings.apart))


def _price(effects: tuple[str, ...], settings: Settings) -> float:
    """Log Bayes factor against the plain model that so many effects must have."""
    return settings.decisive + settings.further * (len(effects) - 1) if effects else 0.0


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


def _step_of(found: Found, samples: Samples) -> Step:
    """The model as a step, with its error on tests left out."""
    held = form_held_out(found.form, samples, found.point)
    return Step(found.effects, found.point, _residuals(found, samples), held, found.form)


def _residuals(found: Found, samples: Samples) -> list[np.ndarray]:
    point = found.point
    coefficients = found.form.split(point.theta)[1]
    predicted = found.form.predict(samples, point.constants[None], coefficients[None])[0]
    return [one - two for one, two in zip(samples.observed, predicted, strict=True)]
