"""One round: every candidate added to the present model, refitted and ranked by its evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import softmax

from qlvbayes.diagnosis.evidence import evidence_of_humps
from qlvbayes.diagnosis.noticeable import log_noticeable
from qlvbayes.diagnosis.screen import Score, screen
from qlvbayes.diagnosis.settings import TOLERANCE, Settings
from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.multistart import climbs_anew, wide_climbs
from qlvbayes.inference.subset import Ensemble
from qlvbayes.inference.together import together

_BEHIND = 15.0  # log evidence behind the best at which a contender is given up
_HOPELESS = 60.0  # at which another relaxation spectrum will not help it either
_STARTS = 2
_WIDE = (3, 2)  # contenders refitted from other relaxation spectra too: best by evidence, by score;
_WIDE_COSTLY = (2, 1)  # fewer where the model runs slowly
_QUOTED = 2
_NEAR = 8.0  # log Bayes factor within which the best are compared more carefully
_CLOSE = 3.0  # within which the best of all are searched for higher humps,
_MOST_CLOSE = 3  # so many of them,
_SEARCHED = 2.0  # if the best has a log Bayes factor above this
_PROMISING = 1.0  # if the best has a log Bayes factor above this; that another hump is higher


@dataclass(frozen=True, eq=False)
class Contender:
    """A candidate beside the present model.

    point: None where the screen settled it; humps: lower tops of the same model's density.
    """

    effect: str
    log_bayes_factor: float
    score: Score
    point: Point | None
    humps: tuple[Point, ...] = ()


@dataclass(frozen=True, eq=False)
class Round:
    """The present model, its contenders, best first, and every effect's scores."""

    base: Point
    contenders: tuple[Contender, ...]
    scores: dict[str, list[Score]] = field(default_factory=dict)

    @property
    def best(self) -> Contender | None:
        """The contender of highest evidence."""
        return self.contenders[0] if self.contenders else None

    def log_weights(self, settings: Settings) -> dict[str, float]:
        """Log of prior probability times Bayes factor, of ``none`` and of every contender."""
        count = max(len(self.contenders), 1)
        share = math.log((1.0 - settings.prior_none) / count)
        own = {c.effect: share + float(c.log_bayes_factor) for c in self.contenders}
        return {"none": math.log(settings.prior_none)} | own

    def probabilities(self, settings: Settings) -> dict[str, float]:
        """Posterior probability of ``none`` and of every contender, if one of them is true."""
        logs = self.log_weights(settings)
        weights = softmax(np.array(list(logs.values())))
        return dict(zip(logs, weights.tolist(), strict=True))

    def lacking(self, settings: Settings) -> float:
        """Posterior probability that something is missing, if ``none`` or a contender is true."""
        return 1.0 - self.probabilities(settings)["none"]


def contest(
    ensemble: Ensemble,
    base: Point,
    effects: list[str],
    *,
    known: float = -math.inf,
    humps: list[Point] | None = None,
    tolerance: float = TOLERANCE,
) -> Round:
    """Rank effects that ``base`` lacks.

    Those whose score promises nothing keep the evidence of the linearised model; the others are
    refitted from the shapes that score best, unless they fall hopelessly behind on the way: behind
    each other, and behind the log evidence ``known`` of a model with one of them. humps: tops of
    the present model's density, where they are known; tolerance: share of the peak force from which
    an effect matters.
    """
    found = screen(ensemble, base, effects)
    ranked = _refitted(ensemble, base, found, known)
    if ranked and ranked[0].log_bayes_factor > _PROMISING:
        humps = humps or wide_climbs(ensemble, base.subset, base.theta)
        if humps[0].loss < base.loss - _PROMISING:
            return contest(
                ensemble, humps[0], effects, known=known, humps=humps, tolerance=tolerance
            )
        for other in _others(ensemble, base, humps):
            ranked = _restarted(ensemble, base, ranked, found, other)
        best = max(known - base.log_evidence, ranked[0].log_bayes_factor)
        ranked = _widened(ensemble, base, ranked, best)
        ranked = _searched(ensemble, ranked)
        ranked = _sampled(ensemble, [base, *humps[1:]], ranked)
    ranked = [weighed(ensemble, contender, tolerance) for contender in ranked]
    return Round(base, tuple(best_first(ranked)), found)


def weighed(ensemble: Ensemble, contender: Contender, tolerance: float = TOLERANCE) -> Contender:
    """The contender, its Bayes factor that of an effect large enough to matter."""
    score, point = contender.score, contender.point
    place = ensemble.amplitude(contender.effect)
    found = (
        (point.constants[place], point.constants_sds[place])
        if point is not None
        else score.posterior
    )
    mean, sd = map(float, found)
    gain = contender.log_bayes_factor + log_noticeable(score.prior, mean, sd, tolerance)
    return replace(contender, log_bayes_factor=gain)


def best_first(contenders: list[Contender]) -> list[Contender]:
    """Sorted by log Bayes factor."""
    return sorted(contenders, key=lambda c: -c.log_bayes_factor)


def _refitted(
    ensemble: Ensemble, base: Point, found: dict[str, list[Score]], known: float
) -> list[Contender]:
    """Contenders from the base, best first.

    The one that scores best goes ahead of the others, which then need not climb as far.
    """
    if not found:
        return []
    first, *others = sorted(found.values(), key=lambda scores: -scores[0].log_bayes_factor)
    leader = _enter(ensemble, base, first, known - _BEHIND)
    best = max(base.log_evidence, known)
    if leader.point is not None:
        best = max(best, leader.point.log_evidence)

    def follow(scores: list[Score]) -> Contender:
        return _enter(ensemble, base, scores, best - _BEHIND)

    return best_first([leader, *together(follow, others)])


def _others(ensemble: Ensemble, base: Point, humps: list[Point]) -> list[np.ndarray]:
    """Theta of the humps that are not the base's, best first, and the priors' centre."""
    plain = ensemble.plain
    away = [h for h in humps if np.abs(h.theta - base.theta)[plain].max() > 1.0]
    return [*(hump.theta for hump in away), ensemble.centre]


def _restarted(
    ensemble: Ensemble,
    base: Point,
    ranked: list[Contender],
    scores: dict[str, list[Score]],
    other: np.ndarray,
) -> list[Contender]:
    """Contenders refitted from another spectrum too, each as long as there is hope, best first.

    Where a mode of the base has taken an effect's place (a fast one a drag's), its score is nothing
    and the way from the base is barred.
    """
    best = ranked[0].log_bayes_factor + base.log_evidence

    def restart(contender: Contender) -> Contender:
        theta = _start(ensemble, base, scores[contender.effect][0])
        theta[ensemble.plain] = other[ensemble.plain]
        subset = ensemble.subset(base.subset.effects | {contender.effect})
        point = climb(ensemble, subset, theta, worth=best - _BEHIND)
        gain = point.log_evidence - base.log_evidence
        if gain > contender.log_bayes_factor:
            return replace(contender, log_bayes_factor=gain, point=point)
        return contender

    return best_first(together(restart, ranked))


def _widened(
    ensemble: Ensemble, base: Point, ranked: list[Contender], best: float
) -> list[Contender]:
    """The most promising contenders refitted from other relaxation spectra too.

    Those whose score promises much count too: on a wrong spectrum the right effect may have been
    given up on its way.
    """
    costly = base.subset.effects & set(ensemble.costly)
    by_evidence, by_score = _WIDE_COSTLY if costly else _WIDE
    # the winner's and the runner-up's figures are quoted, however far apart
    hope = [c for k, c in enumerate(ranked) if k < _QUOTED or c.log_bayes_factor > best - _HOPELESS]
    rest = sorted(hope[by_evidence:], key=lambda c: -c.score.log_bayes_factor)[:by_score]
    chosen = {c.effect for c in hope[:by_evidence]} | {c.effect for c in rest if _promises(c)}

    def widely(contender: Contender) -> Contender:
        if contender.effect not in chosen:
            return contender
        return _widely(ensemble, base, contender, best - _BEHIND)

    return together(widely, ranked)


def _promises(contender: Contender) -> bool:
    return contender.score.log_bayes_factor > _PROMISING


def _widely(ensemble: Ensemble, base: Point, contender: Contender, worth: float) -> Contender:
    if contender.point is None:
        return contender
    start = contender.point
    found = wide_climbs(ensemble, start.subset, start.theta, base.log_evidence + worth)
    return _with_humps(contender, start, found)


def _sampled(
    ensemble: Ensemble, bases: list[Point], contenders: list[Contender]
) -> list[Contender]:
    """Contenders near the best with evidence by importance sampling in place of Laplace's.

    On a ridge or against a bound, where an effect that is not there ends up, Laplace's is too high
    by several units. Where a density has several humps, that of one alone is too low.
    """
    near = _within(contenders, _NEAR)
    plain = evidence_of_humps(ensemble, bases)

    def sampled(contender: Contender) -> Contender:
        if contender.point is None or contender not in near:
            return contender
        gain = evidence_of_humps(ensemble, [contender.point, *contender.humps]) - plain
        return replace(contender, log_bayes_factor=gain)

    return together(sampled, contenders)


def _searched(ensemble: Ensemble, contenders: list[Contender]) -> list[Contender]:
    """Contenders close to the best, if any, with the humps that are found from anywhere."""
    near = _within(contenders, _CLOSE)
    if len(near) < 2 or max(c.log_bayes_factor for c in contenders) < _SEARCHED:
        return contenders
    close = best_first(near)[:_MOST_CLOSE]

    def search(contender: Contender) -> Contender:
        own = contender.point
        if own is None or contender not in close:
            return contender
        return _with_humps(contender, own, climbs_anew(ensemble, own.subset))

    return together(search, contenders)


def _within(contenders: list[Contender], width: float) -> list[Contender]:
    """Fitted contenders whose log Bayes factor is less than that behind the best."""
    best = max(c.log_bayes_factor for c in contenders)
    return [c for c in contenders if c.point is not None and c.log_bayes_factor > best - width]


def _with_humps(contender: Contender, own: Point, found: list[Point]) -> Contender:
    """The contender with more tops of its density, the highest in the place of its own."""
    point, *humps = sorted([own, *contender.humps, *found], key=lambda top: -top.log_evidence)
    gain = contender.log_bayes_factor + point.log_evidence - own.log_evidence
    return replace(contender, log_bayes_factor=gain, point=point, humps=tuple(humps))


def _averaged(scores: list[Score]) -> float:
    """Linear log Bayes factor, averaged over the shapes."""
    values = [score.log_bayes_factor for score in scores]
    return float(np.logaddexp.reduce(values) - math.log(len(values)))


def _enter(ensemble: Ensemble, base: Point, scores: list[Score], worth: float) -> Contender:
    """One effect beside the base, refitted if its scores promise anything."""
    first = scores[0]
    if first.information > 0.0 and max(abs(score.z) for score in scores) <= 1.0:
        return Contender(first.effect, _averaged(scores), first, None)
    point = refit(ensemble, base, scores, worth)
    gain = max(point.log_evidence - base.log_evidence, first.occam)
    return Contender(first.effect, gain, first, point)


def refit(ensemble: Ensemble, base: Point, scores: list[Score], worth: float) -> Point:
    """The best optimum from the shapes that score best, the amplitude where its score puts it."""
    subset = ensemble.subset(base.subset.effects | {scores[0].effect})

    def rise(score: Score) -> Point:
        return climb(ensemble, subset, _start(ensemble, base, score), worth=worth)

    return max(together(rise, scores[:_STARTS]), key=lambda point: point.log_evidence)


def _start(ensemble: Ensemble, base: Point, score: Score) -> np.ndarray:
    """Theta with the amplitude of one Newton step, at least a tenth of its prior sd."""
    effect = ensemble.effect(score.effect)
    prior, sd = score.prior, float(score.prior.sd)
    amplitude = score.amplitude if score.information else 0.5 * sd
    if abs(amplitude) < 0.1 * sd or (score.z < 0.0 and score.prior.word == "halfnormal"):
        amplitude = 0.1 * sd
    amplitude = float(np.clip(amplitude, -5.0 * sd, 5.0 * sd))
    theta = score.theta.copy()
    first = ensemble.fields(effect.name)[list(effect.null).index(next(iter(effect.null)))]
    theta[list(first.theta)] = np.asarray(prior.unconstrain(amplitude))
    own = base.subset.theta
    shift = amplitude * score.shift
    theta[own] = base.theta[own] + shift * min(1.0, 1.0 / max(float(np.max(np.abs(shift))), 1e-9))
    theta[ensemble.noise] = ensemble.centre[ensemble.noise]  # what is missing has swollen the fit's
    return theta
