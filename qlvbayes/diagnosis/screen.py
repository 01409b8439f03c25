"""Score test of every effect at its null, the plain model's own constants projected off.

Rao's score test (1948, doi:10.1017/S0305004100023987): with s the slope of the log likelihood along
an effect's amplitude, J and H the model's own sensitivities and information, z^2 = s^2/I, where
I = s_J - (row) H^-1 (column) is the information left once the constants have been refitted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from qlvbayes.inference.gaussnewton import Point, judge
from qlvbayes.inference.linearised import prior_terms
from qlvbayes.inference.subset import Ensemble
from qlvbayes.priors import HalfNormal, Normal

_SHAPES = 6  # settings of the constants that have no meaning at the null
_BLIND = 1e-10  # of the information that the constants may take without leaving nothing


@dataclass(frozen=True, eq=False)
class Score:
    """One effect at one shape, about a fitted point.

    theta (D,): the fitted point with the effect's shape set; amplitude: what one Newton step gives,
    in units of its constant; information: of the amplitude, constants refitted; total: constants
    held; z: signed root of the score statistic; shift (F,): change of the free numbers a unit of
    amplitude.
    """

    effect: str
    theta: np.ndarray
    amplitude: float
    information: float
    total: float
    z: float
    shift: np.ndarray
    ensemble: Ensemble

    @property
    def prior(self) -> HalfNormal | Normal:
        """Prior of the amplitude."""
        effect = self.ensemble.effect(self.effect)
        return getattr(effect, next(iter(effect.null)))

    @property
    def _ratio(self) -> float:
        """Information of the data over that of the prior."""
        return self.information * float(self.prior.sd) ** 2

    @property
    def posterior(self) -> tuple[float, float]:
        """Mean and sd of the amplitude if the force were linear in it."""
        precision = self.information + 1.0 / float(self.prior.sd) ** 2
        return self.amplitude * self.information / precision, 1.0 / math.sqrt(precision)

    @property
    def occam(self) -> float:
        """What the effect loses if it stays at its null: its evidence is no lower than that."""
        return -0.5 * math.log1p(self._ratio)

    @property
    def log_bayes_factor(self) -> float:
        """Evidence for the effect against none if the force were linear in its amplitude."""
        ratio = self._ratio
        log_bf = 0.5 * self.z**2 * ratio / (1.0 + ratio) + self.occam
        if isinstance(self.prior, Normal):
            return log_bf
        place = self.z * math.sqrt(ratio / (1.0 + ratio))
        return log_bf + math.log(2.0) + float(norm.logcdf(place))


def screen(ensemble: Ensemble, point: Point, effects: list[str]) -> dict[str, list[Score]]:
    """Scores of effects that are off at ``point``, at several shapes each, best first."""
    found: dict[str, list[Score]] = {effect: [] for effect in effects}
    thetas = _shapes(ensemble, point, effects)
    for k, theta in enumerate(thetas):
        some = [effect for effect in effects if k < _count(ensemble, effect)]
        for score in _scores(ensemble, point, theta, some):
            found[score.effect].append(score)
    return {e: sorted(scores, key=lambda s: -s.log_bayes_factor) for e, scores in found.items()}


def _count(ensemble: Ensemble, effect: str) -> int:
    """How many shapes are tried: one where the effect has no more constants than its null."""
    return 1 if len(ensemble.fields(effect)) == len(ensemble.effect(effect).null) else _SHAPES


def _shapes(ensemble: Ensemble, point: Point, effects: list[str]) -> list[np.ndarray]:
    """Thetas (D,) whose first shape runs over the quantiles of its prior, the others at medians."""
    thetas = [point.theta.copy() for _ in range(_SHAPES)]
    for name in effects:
        _, *shapes = ensemble.fields(name)
        for order, place in enumerate(shapes):
            if place.prior is None:
                continue
            for k, theta in enumerate(thetas):
                quantile = (k + 0.5) / _SHAPES if order == 0 else 0.5
                theta[list(place.theta)] = ensemble.quantile(place, quantile)
    return thetas


def _scores(ensemble: Ensemble, point: Point, theta: np.ndarray, effects: list[str]) -> list[Score]:
    """Scores at one setting of the shapes."""
    constants = at_null(ensemble, point, theta, effects)
    amplitudes = [ensemble.amplitude(effect) for effect in effects]
    directions = np.concatenate([point.slopes.T, np.eye(constants.size)[amplitudes]])
    judged = judge(ensemble, constants, directions)
    gradient = np.asarray(judged.gradient).sum(axis=0)
    information = np.asarray(judged.information).sum(axis=0)
    free = point.gradient.size
    shifts = -np.linalg.solve(point.curvature, information[:free, free : free + len(effects)])
    scores = []
    for effect, at, shift in zip(effects, range(free, free + len(effects)), shifts.T, strict=True):
        total = float(information[at, at])
        left = float(total + information[at, :free] @ shift)
        left = left if left > _BLIND * total else 0.0
        # along the shift the density has no slope: the point is its highest
        newton = -float(gradient[at]) / left if left else 0.0
        scores.append(
            Score(effect, theta, newton, left, total, newton * math.sqrt(left), shift, ensemble)
        )
    return scores


def at_null(ensemble: Ensemble, point: Point, theta: np.ndarray, effects: list[str]) -> np.ndarray:
    """The point's constants (P,) with the shapes of theta, every amplitude at its null."""
    shaped = np.asarray(prior_terms(ensemble.posterior, theta).constants)
    constants = point.constants.copy()
    for effect in effects:
        for place in ensemble.fields(effect):
            constants[list(place.constants)] = shaped[list(place.constants)]
    return np.where(np.isnan(point.subset.null), constants, point.subset.null)
