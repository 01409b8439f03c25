"""Effects added one by one, each confirmed, useless ones dropped, until none is decisive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from qlvbayes.checks import NoFiniteForceError
from qlvbayes.diagnosis.contest import Round, contest
from qlvbayes.diagnosis.forms.otherform import AbstractOtherForm
from qlvbayes.diagnosis.heldout import HeldOut, held_out
from qlvbayes.diagnosis.samples import Samples, rmse
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.inference.gaussnewton import Point
from qlvbayes.inference.multistart import wide_climb, wide_climbs
from qlvbayes.inference.subset import Ensemble

_MUCH = 20.0  # log density: the error may rise while another effect is missing that hid behind one
_NO_RISE = 1.001  # times the error before: a difference that no reader of the errors would see

Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Step:
    """A model on the way: its effects in the order added, its optimum and its errors.

    residuals: measured minus predicted force of each trial (n,); form: of an effect that has
    another form than the list's, whose coefficients then follow theta in the point.
    """

    effects: tuple[str, ...]
    point: Point
    residuals: list[np.ndarray]
    heldout: HeldOut
    form: AbstractOtherForm | None = None

    @property
    def rmse(self) -> float:
        """Root mean square of the residuals (N)."""
        return rmse(self.residuals)


@dataclass(eq=False)
class Path:
    """Steps taken and the round held at each.

    refused: contenders that were not confirmed; places: the round over the place of each effect of
    the last model, all others being in.
    """

    steps: list[Step] = field(default_factory=list)
    rounds: list[Round] = field(default_factory=list)
    refused: list[tuple[str, str]] = field(default_factory=list)
    places: dict[str, Round] = field(default_factory=dict)

    @property
    def last(self) -> Step:
        """Where it ended."""
        return self.steps[-1]


def plain_fits(ensemble: Ensemble) -> list[Point]:
    """Tops of the model without effects, from several draws of its prior, the highest first.

    Raises NoFiniteForceError where no draw gives finite forces.
    """
    found = wide_climbs(ensemble, ensemble.subset(), ensemble.centre)
    if not found:
        raise NoFiniteForceError
    return found


def search(
    ensemble: Ensemble,
    samples: Samples,
    candidates: list[str],
    settings: Settings,
    tell: Tell = lambda text: None,
) -> Path:
    """Add the best confirmed effect until none is decisive."""
    path = Path()
    tell("fitting the plain model")
    plain = plain_fits(ensemble)
    path.steps.append(step_at(ensemble, samples, (), plain[0]))
    while True:
        present = path.last
        if len(present.effects) >= settings.most:
            return path
        tell(f"ranking what {' + '.join(('QLV', *present.effects))} may lack")
        left = [name for name in candidates if name not in present.effects]
        humps = None if path.rounds else plain
        least = settings.tolerance
        path.rounds.append(contest(ensemble, present.point, left, humps=humps, tolerance=least))
        earlier = len(path.refused)
        confirmed = _confirmed(ensemble, samples, path, settings)
        if confirmed is None and len(path.refused) > earlier:
            confirmed = _with_another(ensemble, samples, path, path.refused[earlier][0], settings)
        if confirmed is None:
            return path
        path.steps.append(_without_useless(ensemble, samples, confirmed, settings))
        if any(set(s.effects) == set(path.last.effects) for s in path.steps[:-1]):
            path.steps.pop()  # back where it was: the gain was not real
            return path


def step_at(ensemble: Ensemble, samples: Samples, effects: tuple[str, ...], point: Point) -> Step:
    """A model with its errors."""
    residuals = samples.residuals(point.constants)
    return Step(effects, point, residuals, held_out(ensemble, samples, point))


def _confirmed(ensemble: Ensemble, samples: Samples, path: Path, settings: Settings) -> Step | None:
    """The best contender that evidence and held-out tests both accept."""
    present = path.last
    least = settings.further if present.effects else settings.decisive
    if not present.effects and path.rounds[0].lacking(settings) < settings.lacking:
        return None
    step, refused = _first_good(ensemble, samples, path.rounds[-1], present.effects, present, least)
    path.refused += [(name, "it predicts left-out tests no better") for name in refused]
    return step


def _first_good(
    ensemble: Ensemble,
    samples: Samples,
    found: Round,
    beside: tuple[str, ...],
    before: Step,
    least: float,
) -> tuple[Step | None, list[str]]:
    """The best contender that left-out tests accept beside others, and those refused before it."""
    refused: list[str] = []
    for contender in found.contenders[:3]:
        if contender.log_bayes_factor < least or contender.point is None:
            break
        step = step_at(ensemble, samples, (*beside, contender.effect), contender.point)
        if confirms(step, before):
            return step, refused
        refused.append(contender.effect)
    return None, refused


def _with_another(
    ensemble: Ensemble, samples: Samples, path: Path, first: str, settings: Settings
) -> Step | None:
    """The best refused contender with another effect, if left-out tests confirm the two together.

    Where both bend the constants, a model with one alone may predict no better. The step between
    joins the path.
    """
    present = path.last
    effects = (*present.effects, first)
    if len(effects) >= settings.most:
        return None
    held = path.rounds[-1]
    refused = next(c for c in held.contenders if c.effect == first)
    left = [c.effect for c in held.contenders if c.effect != first]
    assert refused.point is not None  # else it would not have been refused
    found = contest(ensemble, refused.point, left, tolerance=settings.tolerance)
    both, _ = _first_good(ensemble, samples, found, effects, present, settings.further)
    if both is not None:
        path.steps.append(step_at(ensemble, samples, effects, refused.point))
        path.rounds.append(found)
        path.refused = [one for one in path.refused if one[0] not in both.effects]
    return both


def confirms(step: Step, before: Step) -> bool:
    """Whether left-out tests are predicted better than by the model before.

    Their log density must rise, and not by noise that swells: their weighed error must not rise,
    unless the log density rises by more than such noise makes.
    """
    after, first = step.heldout, before.heldout
    gain = after.score - first.score
    return gain > _MUCH or (gain > 0.0 and after.weighed < _NO_RISE * first.weighed)


def _without_useless(ensemble: Ensemble, samples: Samples, step: Step, settings: Settings) -> Step:
    """Drop earlier effects without which the evidence is no lower."""
    for name in step.effects[:-1]:
        less = tuple(effect for effect in step.effects if effect != name)
        point = wide_climb(ensemble, ensemble.subset(less), step.point.theta)
        if point.log_evidence > step.point.log_evidence:
            return _without_useless(
                ensemble, samples, step_at(ensemble, samples, less, point), settings
            )
    return step
