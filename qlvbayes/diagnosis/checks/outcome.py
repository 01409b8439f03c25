"""A finished search in figures: probabilities, errors, tests of what is left, each made once."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from qlvbayes.diagnosis.checks.adequacy import Adequacy, adequacy
from qlvbayes.diagnosis.checks.decisive import decisive
from qlvbayes.diagnosis.checks.heldout import Part, Predicted, errors, leave_out, predictions
from qlvbayes.diagnosis.checks.remainder import Remainder, remainder
from qlvbayes.diagnosis.checks.samples import Samples, cell_errors, rmse
from qlvbayes.diagnosis.decision import probabilities
from qlvbayes.diagnosis.prior import log_odds_of_effect
from qlvbayes.diagnosis.result import (
    Alternative,
    Decisive,
    Estimate,
    Laws,
    NotRuledOut,
    Place,
    Ranked,
    Stage,
)
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.standing import weights_of
from qlvbayes.diagnosis.weighed import Weighed
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.model.parameters import unit_kinds
from qlvbayes.motion.experiment import Experiment

Array = NDArray[np.float64]

LEAST = 0.02  # probability of what is told: 50 to 1
_TOGETHER = 0.05  # probability of a hypothesis whose prediction counts beside others
_LISTED = 3  # sets of effects that are told as not ruled out
_ALTERNATIVES = 10  # hypotheses told


class Outcome:
    """One search's posterior over hypotheses, and figures of any of them."""

    def __init__(self, experiment: Experiment, search: Search) -> None:
        self.experiment, self.search = experiment, search
        self.samples = Samples.of(experiment, search.density.space)
        self.seen = list(search.seen.values())
        self.weights = weights_of(search)
        self.draws = probabilities(self.weights)
        self.shares = self.draws.mean(axis=0)
        self._predictions: dict[Hypothesis, list[Predicted]] = {}
        self._residuals: dict[Hypothesis, list[Array]] = {}
        self.unpredicted: set[Hypothesis] = set()  # that give no number at some samples
        self._tested: dict[Hypothesis, Adequacy] = {}

    def heldout(self, found: Weighed) -> float:
        """Error on tests left out (N)."""
        return errors(self.samples, self._parts, [self._predicted(found)]).rmse

    @cached_property
    def _parts(self) -> list[Part]:
        """What is left out in turn."""
        return leave_out(self.search.density, self.samples)

    def heldout_of_all(self) -> float | None:
        """Error on tests left out (N) of what the likeliest hypotheses predict together."""
        likely = np.flatnonzero(self.shares >= _TOGETHER)
        found = [self.seen[k] for k in likely]
        if len(found) < 2:
            return None
        prior = [self.search.log_prior(one.hypothesis) for one in found]
        predicted = [self._predicted(one) for one in found]
        return _finite(errors(self.samples, self._parts, predicted, prior).rmse)

    def _predicted(self, found: Weighed) -> list[Predicted]:
        """What a hypothesis predicts of each part left out, refitted once."""
        if found.hypothesis not in self._predictions:
            predicted = predictions(self.samples, self._parts, found)
            self._predictions[found.hypothesis] = predicted
        return self._predictions[found.hypothesis]

    def residuals(self, found: Weighed) -> list[Array]:
        """Measured minus predicted force of each trial's samples (N).

        Where a hypothesis predicts no number, all that is measured: it predicts nothing there.
        """
        if found.hypothesis not in self._residuals:
            residuals = self.samples.residuals(found.hypothesis, found.point.constants)
            known = [np.isfinite(one) for one in residuals]
            if not all(one.all() for one in known):
                self.unpredicted.add(found.hypothesis)
            self._residuals[found.hypothesis] = [
                np.where(here, one, force)
                for here, one, force in zip(known, residuals, self.samples.observed, strict=True)
            ]
        return self._residuals[found.hypothesis]

    def tested(self, found: Weighed) -> Adequacy:
        """Whether structure is left."""
        if found.hypothesis not in self._tested:
            record = self.search.density.space.record
            self._tested[found.hypothesis] = adequacy(
                self.experiment, record, found.point, self.search.settings.cells
            )
        return self._tested[found.hypothesis]

    def left(self, found: Weighed) -> Remainder:
        """Size of what a hypothesis leaves."""
        residuals, test = self.residuals(found), self.tested(found)
        plain = self.residuals(self.search.modes[self.search.usual][0])
        peak, settings = self.experiment.scales.force, self.search.settings
        return remainder(self.samples, residuals, test, plain, peak=peak, settings=settings)

    def beyond_white(self, found: Weighed) -> float:
        """By how much the error of all samples exceeds the white part of the noise (N)."""
        white = [self.experiment.floor.white * own for own in self.samples.weights]
        noise = float(np.mean(np.concatenate(white) ** 2))
        return math.sqrt(max(rmse(self.residuals(found)) ** 2 - noise, 0.0))

    def stage(self, found: Weighed) -> Stage:
        """One hypothesis in figures."""
        residuals, tested = self.residuals(found), self.tested(found)
        level = 0.5 * self.search.settings.false_alarms / len(tested.cells)
        return Stage(
            base=Laws(*found.hypothesis.base),
            effects=tuple(self._ordered(found)),
            rmse=rmse(residuals),
            heldout_rmse=_finite(self.heldout(found)),
            log_evidence=_finite(found.log_evidence),
            p_value=tested.p_value,
            testable=tested.testable,
            failing=tuple(Place(c.test, c.phase) for c in tested.cells if c.p_value < level),
            cells=tuple(cell_errors(self.samples, residuals)),
            parameters=self.estimates(found, lambda name: not name.startswith("noise.")),
        )

    def _ordered(self, found: Weighed) -> list[str]:
        """Its effects, the surest first."""
        names = self.search.added(found.hypothesis)
        return sorted(names, key=lambda name: -self.inclusion(self.search.families.of[name]))

    def inclusion(self, effect: str) -> float:
        """Probability that an effect is in the model, in whichever of its forms."""
        return self._summed(np.array([effect in weight.effects for weight in self.weights]))

    def _summed(self, inside: NDArray[np.bool_]) -> float:
        return min(float(self.shares[inside].sum()), 1.0)

    def estimates(self, found: Weighed, wanted: Callable[[str], bool]) -> dict[str, Estimate]:
        """Constants at a mode, by Laplace's approximation."""
        point, kinds = found.point, unit_kinds(found.point.own.posterior)
        covariance = found.evidence.covariance + found.evidence.spread
        spread = point.slopes @ covariance @ point.slopes.T
        sds = np.sqrt(np.maximum(np.diag(spread), 0.0))
        return {
            name: Estimate(self.experiment.units.of(kind), float(value), float(sd))
            for name, kind, value, sd in zip(
                point.own.names, kinds, point.constants, sds, strict=True
            )
            if wanted(name)
        }

    def ranking(self) -> tuple[Ranked, ...]:
        """``none`` and every effect by inclusion probability."""
        usual = self.search.usual.effects
        candidates = [n for n in self.search.families.listed if n not in usual]
        prior = log_odds_of_effect(len(candidates), self.search.settings)
        logs = np.array([weight.log_posterior for weight in self.weights])
        counts = np.array([max(len(weight.effects), 1) for weight in self.weights])
        ranked: list[tuple[float, Ranked]] = []
        for name in ("none", *candidates):
            inside = np.array(
                [not w.effects if name == "none" else name in w.effects for w in self.weights]
            )
            if not inside.any():
                continue
            place = int(np.argmax(np.where(inside, logs, -np.inf)))
            best, form = self.seen[place], self.weights[place].forms.get(name, name)
            odds = _log_odds(logs, inside) - (0.0 if name == "none" else prior)
            own = self.estimates(best, partial(_starts, f"{form}."))
            found = {key.removeprefix(f"{form}."): value for key, value in own.items()}
            share = self._summed(inside)
            alone = float((self.shares / counts)[inside].sum())
            error = rmse(self.residuals(best))
            spread = float(self.draws[:, inside].sum(axis=1).std())
            half = self._half(best, form) if name != "none" and share >= LEAST else None
            entry = Ranked(name, share, alone, _finite(odds), error, found, spread, half)
            ranked.append((odds, entry))
        ranked.sort(key=lambda pair: (-pair[1].inclusion, -pair[0]))
        return tuple(one for _, one in ranked)

    def _half(self, found: Weighed, effect: str) -> Decisive | None:
        """In how many readings half of an effect's evidence lies, if the rest was seen without."""
        without = self.search.seen.get(found.hypothesis.less(effect))
        if without is None:
            return None
        return decisive(self.search.density, self.experiment.trials, found, without)

    def constants(self, told: Weighed) -> dict[str, Estimate]:
        """The base law's, averaged over all hypotheses on the same laws."""
        base = told.hypothesis.base
        same = [k for k, weight in enumerate(self.weights) if weight.base == base]
        logs = [self.weights[k].log_posterior for k in same]
        near = [k for k, log in zip(same, logs, strict=True) if log > max(logs) - 10.0]
        found = [self.estimates(self.seen[k], _is_plain) for k in near]
        return averaged([self.weights[k].log_posterior for k in near], found)

    def sets(self) -> tuple[NotRuledOut, ...]:
        """Sets of effects over all base laws, the likeliest first."""
        found: dict[frozenset[str], float] = {}
        for weight, share in zip(self.weights, self.shares.tolist(), strict=True):
            found[weight.effects] = found.get(weight.effects, 0.0) + share
        best = sorted(found.items(), key=lambda item: -item[1])[:_LISTED]
        return tuple(NotRuledOut(tuple(sorted(s)), p) for s, p in best if p >= LEAST)

    def alternatives(self) -> tuple[Alternative, ...]:
        """Single hypotheses, the likeliest first."""
        order = np.argsort(-self.shares)[:_ALTERNATIVES]
        return tuple(
            Alternative(
                Laws(*self.weights[k].base),
                tuple(self.search.added(self.seen[k].hypothesis)),
                float(self.shares[k]),
                _finite(self.seen[k].log_evidence),
                _finite(self.seen[k].error),
            )
            for k in order
            if self.shares[k] >= LEAST
        )


def _log_odds(logs: Array, inside: NDArray[np.bool_]) -> float:
    if inside.all():
        return math.inf
    return float(logsumexp(logs[inside]) - logsumexp(logs[~inside]))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _is_plain(name: str) -> bool:
    return "." not in name


def _starts(prefix: str, name: str) -> bool:
    return name.startswith(prefix)


def averaged(
    log_weights: Sequence[float], hypotheses: Sequence[Mapping[str, Estimate]]
) -> dict[str, Estimate]:
    r"""Mean and sd of every constant that all hypotheses have.

    With weights w proportional to the posterior probability of each hypothesis (Hoeting et al.
    1999, doi:10.1214/ss/1009212519),

    .. math:: \mu = \sum_k w_k \mu_k, \quad \sigma^2 = \sum_k w_k (\sigma_k^2 + (\mu_k - \mu)^2)
    """
    weights = softmax(np.asarray(log_weights, dtype=float))
    first, *others = hypotheses
    return {
        name: _mixture(weights, [found[name] for found in hypotheses])
        for name in first
        if all(name in found for found in others)
    }


def _mixture(weights: Array, found: Sequence[Estimate]) -> Estimate:
    means, sds = (np.array([getattr(e, key) for e in found]) for key in ("mean", "sd"))
    mean = float(weights @ means)
    variance = float(weights @ (sds**2 + (means - mean) ** 2))
    return Estimate(found[0].unit, mean, variance**0.5)
