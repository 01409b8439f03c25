"""Which effects are tried in another form, and which of them side by side."""

from __future__ import annotations

import math
from collections.abc import Iterator

from qlvbayes.diagnosis.contest import Round, refit
from qlvbayes.diagnosis.forms.otherform import AbstractOtherForm, OtherForm
from qlvbayes.diagnosis.forms.ownforms import OWN_FORMS
from qlvbayes.diagnosis.search import Path
from qlvbayes.experiment import Experiment
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.subset import Ensemble

_FIRST = 3  # contenders of the first round that are tried
Model = tuple[tuple[str, ...], Point]  # its effects, its optimum
Attempt = tuple[AbstractOtherForm, tuple[str, ...], Point]  # and what it starts from


def turns(
    experiment: Experiment, ensemble: Ensemble, path: Path, sound: bool
) -> list[list[Attempt]]:
    """What is tried together, one list after the other.

    Steps on the way, the fewest effects first, then the best contenders of the first round; where
    the last step is ``sound``, only steps before it, and these if it has no effects.
    """
    steps = sorted(_steps(path, sound), key=_count)
    known = [effects for effects, _ in steps]
    others = [model for model in _contenders(path, sound) if model[0] not in known]
    found = [
        [attempt for model in models for attempt in _forms(experiment, ensemble, *model)]
        for models in [*([step] for step in steps), others]
    ]
    known += [effects for effects, _ in others]
    distant = _distant(experiment, ensemble, path)
    found[0] += [one for one in distant if one[1] not in (*known, path.last.effects)]
    return found


def _steps(path: Path, sound: bool) -> list[Model]:
    return [(step.effects, step.point) for step in path.steps[1 : -1 if sound else None]]


def _contenders(path: Path, sound: bool) -> list[Model]:
    if sound and path.last.effects:
        return []
    best = path.rounds[0].contenders[:_FIRST]
    return [((c.effect,), c.point) for c in best if c.point is not None]


def _count(model: Model) -> int:
    return len(model[0])


def _distant(experiment: Experiment, ensemble: Ensemble, path: Path) -> Iterator[Attempt]:
    """Effects in forms of which the list's law may explain a part only."""
    first = path.rounds[0]
    for contender in first.contenders:
        kind = OWN_FORMS.get(contender.effect, OtherForm)
        if kind.distant:
            listed = contender.point or _fitted(ensemble, first, contender.effect)
            form = kind(experiment, ensemble, listed.subset, contender.effect)
            yield form, (contender.effect,), listed


def _fitted(ensemble: Ensemble, first: Round, effect: str) -> Point:
    """The list's law of an effect that promised nothing."""
    return refit(ensemble, first.base, first.scores[effect], -math.inf)


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
