"""Where there are two or more effects, another may do better in one's place, or none as well."""

from __future__ import annotations

from dataclasses import replace

from qlvbayes.diagnosis.contest import Contender, Round, best_first, contest, weighed
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.diagnosis.search import Path, Step, Tell, confirms, step_at
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.inference.multistart import wide_climb
from qlvbayes.inference.subset import Ensemble

_TURNS = 5


def settle(
    ensemble: Ensemble,
    samples: Samples,
    path: Path,
    candidates: list[str],
    settings: Settings,
    tell: Tell,
) -> None:
    """Put better effects in the place of earlier picks, until every one is the best in its place.

    A pick made while something else was still missing may have been wrong, and one that is no
    longer decisive beside all the others goes. Leaves in ``path.places`` the round held over each
    effect's place.
    """
    for _ in range(_TURNS):
        path.places = {}
        if len(path.last.effects) < 2:
            break
        tell(f"weighing each of {' + '.join(path.last.effects)} against the others")
        better = None
        for effect in path.last.effects:
            path.places[effect] = found = _round_over(ensemble, path, effect, candidates, settings)
            better = _better(ensemble, samples, path.last, effect, found)
            if better is not None:
                break
        better = better or _without_weakest(ensemble, samples, path, settings)
        if better is None:
            return
        path.steps.append(better)
    path.places = {}
    if len(path.last.effects) == 1:
        path.places = {path.last.effects[0]: _with_last(ensemble, path, settings)}


def _with_last(ensemble: Ensemble, path: Path, settings: Settings) -> Round:
    """The first round, with the only effect at the last step's optimum."""
    first, last = path.rounds[0], path.last
    if len(path.steps) <= 2:
        return first
    return _held(ensemble, first, last, last.effects[0], settings)


def _held(ensemble: Ensemble, found: Round, last: Step, effect: str, settings: Settings) -> Round:
    """A round over an effect's place, in which the effect has the last step's optimum at least."""
    gain = last.point.log_evidence - found.base.log_evidence

    def at_last(contender: Contender) -> Contender:
        if contender.effect != effect:
            return contender
        later = replace(contender, point=last.point, log_bayes_factor=gain)
        later = weighed(ensemble, later, settings.tolerance)
        return max(later, contender, key=lambda one: one.log_bayes_factor)

    return replace(found, contenders=tuple(best_first(list(map(at_last, found.contenders)))))


def _round_over(
    ensemble: Ensemble, path: Path, effect: str, candidates: list[str], settings: Settings
) -> Round:
    """The round over one effect's place, all others being in."""
    last = path.last
    if effect == last.effects[-1] and path.steps[-2].effects == last.effects[:-1]:
        return path.rounds[len(path.steps) - 2]
    rest = tuple(name for name in last.effects if name != effect)
    base = wide_climb(ensemble, ensemble.subset(rest), last.point.theta)
    left = [name for name in candidates if name not in rest]
    known, least = last.point.log_evidence, settings.tolerance
    found = contest(ensemble, base, left, known=known, tolerance=least)
    return _held(ensemble, found, last, effect, settings)


def _better(
    ensemble: Ensemble, samples: Samples, last: Step, effect: str, found: Round
) -> Step | None:
    """The model with the best contender in an effect's place, if it is another and confirmed."""
    best = found.best
    if best is None or best.effect == effect or best.point is None:
        return None
    rest = tuple(name for name in last.effects if name != effect)
    step = step_at(ensemble, samples, (*rest, best.effect), best.point)
    return step if confirms(step, last) else None


def _without_weakest(
    ensemble: Ensemble, samples: Samples, path: Path, settings: Settings
) -> Step | None:
    """The model without the effect that adds least beside all others, if that is not decisive."""
    gains = {
        effect: _holder(found, effect).log_bayes_factor for effect, found in path.places.items()
    }
    weakest = min(gains, key=lambda effect: gains[effect])
    if gains[weakest] >= settings.further:
        return None
    rest = tuple(name for name in path.last.effects if name != weakest)
    return step_at(ensemble, samples, rest, path.places[weakest].base)


def _holder(found: Round, effect: str) -> Contender:
    return next(c for c in found.contenders if c.effect == effect)


def rivals(path: Path, settings: Settings) -> tuple[Contender, ...]:
    """The place where most contenders are not told ``apart`` from its holder; the holder first."""
    if not path.places:
        return ()
    near = [_near(found, effect, settings) for effect, found in path.places.items()]
    return max(near, key=len)


def _near(found: Round, effect: str, settings: Settings) -> tuple[Contender, ...]:
    holder = _holder(found, effect)
    near = [
        c
        for c in found.contenders
        if c.effect != effect
        and c.point is not None
        and holder.log_bayes_factor - c.log_bayes_factor < settings.apart
    ]
    return (holder, *near)
