"""The outcome of a search: probabilities, errors and tests of its hypotheses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.adequacy import Adequacy, adequacy
from qlvbayes.diagnosis.checks.decisive import decisive
from qlvbayes.diagnosis.checks.heldout import HeldOut, HeldOutPart, error, leave_out, predicted
from qlvbayes.diagnosis.checks.remainder import Remainder, remainder
from qlvbayes.diagnosis.checks.samples import Samples, cell_errors, rmse
from qlvbayes.diagnosis.decision import probabilities, require
from qlvbayes.diagnosis.prior import log_odds_of_effect
from qlvbayes.diagnosis.progress import weights_of
from qlvbayes.diagnosis.result import (
    Alternative,
    Decisive,
    Estimate,
    LawPair,
    NotRuledOut,
    Ranked,
    Stage,
    StructuredPhase,
)
from qlvbayes.diagnosis.search import Search
from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.starts import without
from qlvbayes.io.arrays import Array, finite_or_none
from qlvbayes.io.units import UnitSystem
from qlvbayes.model.parameters import unit_kinds
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.facts import OF_UNLOADING, loaded_once

LEAST = 0.02
"""Probability (odds of 50 to 1) below which something is not reported."""
_SETS = 3  # sets of effects that are reported as not ruled out
_ALTERNATIVES = 10  # hypotheses that are reported
_NEGLIGIBLE = 10.0  # log posterior behind the best from which averages leave a hypothesis out


class SearchOutcome:
    """The posterior over the H hypotheses of one search, and figures of any of them.

    Figures that take a fit are computed once. ``candidates``, ``weights`` and ``shares`` (H,) hold
    each hypothesis, its weight and its probability, ``draws`` (D, H) the probabilities within the
    errors of the evidences, ``unpredicted`` the hypotheses that predict no finite force at some
    samples. Effects that are ``measured`` in the records beyond doubt are in every hypothesis that
    counts, where the search knows one with all of them.
    """

    def __init__(self, experiment: Experiment, search: Search) -> None:
        self.experiment, self.search = experiment, search
        candidates = set(search.families.nameable) - search.baseline.effects
        self.measured = candidates.intersection(search.measured)
        point = search.modes[search.baseline][0].point
        model = point.own.model_at(point.constants)
        self.samples = Samples.from_experiment(experiment, search.density.space, model)
        self.candidates = list(search.candidates.values())
        known = weights_of(search)
        self.without_evidence = sum(not weight.counts for weight in known)
        self.weights = require(known, self.measured)
        self.draws = probabilities(self.weights)
        self.shares = self.draws.mean(axis=0)
        self._left_out: dict[Hypothesis, list[HeldOut]] = {}
        self._residuals: dict[Hypothesis, list[Array]] = {}
        self.unpredicted: set[Hypothesis] = set()
        self._adequacies: dict[Hypothesis, Adequacy] = {}

    @cached_property
    def alike(self) -> tuple[str, ...]:
        """Effects that follow the largest depth, where only one test loads, and only once."""
        return OF_UNLOADING if loaded_once(self.experiment) else ()

    def left_out(self, candidate: Candidate) -> list[HeldOut]:
        """Return what a candidate predicts of each part by a fit to all others."""
        hypothesis = candidate.hypothesis
        if hypothesis not in self._left_out:
            self._left_out[hypothesis] = predicted(self.samples, self._parts, candidate.mode)
        return self._left_out[hypothesis]

    def acting(self, candidate: Candidate, effect: str) -> list[Array]:
        """Return the force (N) of an effect of a candidate at the samples of each part."""
        point = candidate.point
        rest = self.samples.predict(*without(self.search.density.space, point, effect))
        having = self.samples.predict(candidate.hypothesis, point.constants[None])
        return [(having[part.test][0] - rest[part.test][0])[part.rows] for part in self._parts]

    @cached_property
    def _parts(self) -> list[HeldOutPart]:
        """The parts that are left out in turn."""
        return leave_out(self.search.density, self.samples)

    def residuals(self, candidate: Candidate) -> list[Array]:
        """Return measured minus predicted force (N) of each test's samples."""
        hypothesis = candidate.hypothesis
        if hypothesis not in self._residuals:
            residuals = self.samples.residuals(self.search.density, candidate.mode)
            known = [np.isfinite(one) for one in residuals]
            if not all(one.all() for one in known):
                self.unpredicted.add(hypothesis)
            self._residuals[hypothesis] = [
                np.where(here, one, force)
                for here, one, force in zip(known, residuals, self.samples.observed, strict=True)
            ]
        return self._residuals[hypothesis]

    def adequacy(self, candidate: Candidate) -> Adequacy:
        """Return the adequacy test of a candidate."""
        hypothesis = candidate.hypothesis
        if hypothesis not in self._adequacies:
            record = self.search.density.space.record
            self._adequacies[hypothesis] = adequacy(
                self.experiment, record, candidate.point, self.search.settings.cells
            )
        return self._adequacies[hypothesis]

    def remainder(self, candidate: Candidate) -> Remainder:
        """Return the size of the structure that a candidate leaves."""
        residuals, test = self.residuals(candidate), self.adequacy(candidate)
        baseline = self.residuals(self.search.modes[self.search.baseline][0])
        peak, settings = self.experiment.scales.force, self.search.settings
        return remainder(self.samples, residuals, test, baseline, peak=peak, settings=settings)

    def beyond_white(self, candidate: Candidate) -> float:
        """Return by how much the error of all samples exceeds the white noise (N)."""
        white = [self.experiment.floor.white * own for own in self.samples.weights]
        noise = float(np.mean(np.concatenate(white) ** 2))
        return math.sqrt(max(rmse(self.residuals(candidate)) ** 2 - noise, 0.0))

    def stage(self, candidate: Candidate) -> Stage:
        """Return the figures of one candidate."""
        residuals, tested = self.residuals(candidate), self.adequacy(candidate)
        level = 0.5 * self.search.settings.false_alarms / len(tested.cells)
        return Stage(
            base=LawPair(*candidate.hypothesis.base),
            effects=tuple(self._ordered(candidate)),
            rmse=self.samples.error(residuals),
            heldout_rmse=finite_or_none(error(self.left_out(candidate))),
            log_evidence=finite_or_none(candidate.log_evidence),
            p_value=tested.p_value,
            testable=tested.testable,
            failing=tuple(
                dict.fromkeys(
                    StructuredPhase(c.test, c.phase) for c in tested.cells if c.p_value < level
                )
            ),
            cells=tuple(cell_errors(self.samples, residuals)),
            parameters=self.estimates(candidate, lambda name: not name.startswith("noise.")),
        )

    def _ordered(self, candidate: Candidate) -> list[str]:
        """Return the effects of a candidate, the most probable first."""
        names = self.search.added(candidate.hypothesis)
        return sorted(names, key=lambda name: -self.inclusion(self.search.families.family_of[name]))

    def inclusion(self, effect: str) -> float:
        """Return the probability that an effect is in the model, in any of its forms."""
        return self._share_of(self.having(effect))

    def having(self, effect: str) -> NDArray[np.bool_]:
        """Return which hypotheses (H,) have an effect, in any of its forms."""
        return np.array([effect in weight.effects for weight in self.weights])

    def most_probable(self, inside: NDArray[np.bool_]) -> int:
        """Return the index of the most probable of some hypotheses, a mask (H,)."""
        return int(np.argmax(np.where(inside, self._log_posteriors, -np.inf)))

    def _share_of(self, inside: NDArray[np.bool_]) -> float:
        """Return the total probability of some hypotheses, as a mask (H,)."""
        return min(float(self.shares[inside].sum()), 1.0)

    def estimates(self, candidate: Candidate, wanted: Callable[[str], bool]) -> dict[str, Estimate]:
        """Return the wanted constants of a candidate by name, by Laplace's approximation."""
        point = candidate.point
        covariance = candidate.evidence.covariance + candidate.evidence.spread
        spread = point.slopes @ covariance @ point.slopes.T
        sds = np.sqrt(np.maximum(np.diag(spread), 0.0))
        every = estimates_at(self.experiment.units, point, sds)
        return {name: estimate for name, estimate in every.items() if wanted(name)}

    def ranking(self) -> tuple[Ranked, ...]:
        """Return ``none`` and every candidate effect, the most probable first."""
        chosen = self.search.baseline.effects
        names = [name for name in self.search.families.nameable if name not in chosen]
        log_prior_odds = log_odds_of_effect(len(names), self.search.settings)
        ranked: list[tuple[float, Ranked]] = []
        for name in ("none", *names):
            without_any = np.array([not weight.effects for weight in self.weights])
            inside = without_any if name == "none" else self.having(name)
            if inside.any():
                odds = _log_odds(self._log_posteriors, inside)
                odds -= 0.0 if name == "none" else log_prior_odds
                ranked.append((odds, self._ranked(name, inside, odds)))
        ranked.sort(key=lambda pair: (-pair[1].inclusion, -pair[0]))
        return tuple(one for _, one in ranked)

    @cached_property
    def _log_posteriors(self) -> Array:
        return np.array([weight.log_posterior for weight in self.weights])

    def _ranked(self, name: str, inside: NDArray[np.bool_], odds: float) -> Ranked:
        """Return the entry of one effect, which the hypotheses in a mask (H,) contain."""
        index = self.most_probable(inside)
        best, form = self.candidates[index], self.weights[index].forms.get(name, name)
        own = self.estimates(best, lambda name: name.startswith(f"{form}."))
        counts = np.array([max(len(weight.effects), 1) for weight in self.weights])
        share = self._share_of(inside)
        return Ranked(
            effect=name,
            inclusion=share,
            probability=float((self.shares / counts)[inside].sum()),
            log_bayes_factor=finite_or_none(odds),
            rmse=self.samples.error(self.residuals(best)),
            parameters={key.removeprefix(f"{form}."): value for key, value in own.items()},
            inclusion_error=float(self.draws[:, inside].sum(axis=1).std()),
            half=self._half(best, form) if name != "none" and share >= LEAST else None,
        )

    def _half(self, candidate: Candidate, effect: str) -> Decisive | None:
        """Return in how many readings half of an effect's evidence lies."""
        without = self.search.candidates.get(candidate.hypothesis.less(effect))
        if without is None:
            return None
        return decisive(self.search.density, self.experiment.trials, candidate, without)

    def constants(self, selected: Candidate) -> dict[str, Estimate]:
        """Return the constants of the base laws, averaged over all hypotheses with these laws."""
        base = selected.hypothesis.base
        same = [k for k, weight in enumerate(self.weights) if weight.base == base]
        least = max(self.weights[k].log_posterior for k in same) - _NEGLIGIBLE
        near = [k for k in same if self.weights[k].log_posterior > least]
        estimates = [self.estimates(self.candidates[k], lambda name: "." not in name) for k in near]
        return averaged([self.weights[k].log_posterior for k in near], estimates)

    def sets(self) -> tuple[NotRuledOut, ...]:
        """Return the sets of effects over all base laws, the most probable first."""
        totals: dict[frozenset[str], float] = {}
        for weight, share in zip(self.weights, self.shares.tolist(), strict=True):
            totals[weight.effects] = totals.get(weight.effects, 0.0) + share
        best = sorted(totals.items(), key=lambda item: -item[1])[:_SETS]
        return tuple(NotRuledOut(tuple(sorted(s)), p) for s, p in best if p >= LEAST)

    def alternatives(self) -> tuple[Alternative, ...]:
        """Return single hypotheses, the most probable first."""
        order = np.argsort(-self.shares)[:_ALTERNATIVES]
        return tuple(
            Alternative(
                LawPair(*self.weights[k].base),
                tuple(self.search.added(self.candidates[k].hypothesis)),
                float(self.shares[k]),
                finite_or_none(self.candidates[k].log_evidence),
                finite_or_none(self.candidates[k].error),
            )
            for k in order
            if self.shares[k] >= LEAST
        )


def estimates_at(units: UnitSystem, point: Point, sds: Array) -> dict[str, Estimate]:
    """Return every constant at a point by its name, with sds (P,) and its unit."""
    kinds = unit_kinds(point.own)
    return {
        name: Estimate(units.of(kind), float(value), float(sd))
        for name, kind, value, sd in zip(point.own.names, kinds, point.constants, sds, strict=True)
    }


def _log_odds(logs: Array, inside: NDArray[np.bool_]) -> float:
    """Return the log posterior odds of some hypotheses, a mask (H,), against all others."""
    if inside.all():
        return math.inf
    return float(logsumexp(logs[inside]) - logsumexp(logs[~inside]))


def averaged(
    log_weights: Sequence[float], hypotheses: Sequence[Mapping[str, Estimate]]
) -> dict[str, Estimate]:
    r"""Return mean and sd of every constant that all hypotheses have.

    The weights w are proportional to the posterior probability of each hypothesis (Hoeting et al.
    1999, doi:10.1214/ss/1009212519):

    .. math:: \mu = \sum_k w_k \mu_k, \quad \sigma^2 = \sum_k w_k (\sigma_k^2 + (\mu_k - \mu)^2)
    """
    weights = softmax(np.asarray(log_weights, dtype=float))
    found = {}
    for name, first in hypotheses[0].items():
        if all(name in own for own in hypotheses):
            means, sds = np.array([(own[name].mean, own[name].sd) for own in hypotheses]).T
            mean = float(weights @ means)
            variance = float(weights @ (sds**2 + (means - mean) ** 2))
            found[name] = Estimate(first.unit, mean, variance**0.5)
    return found
