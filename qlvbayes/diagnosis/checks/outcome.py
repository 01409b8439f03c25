"""The outcome of a search: probabilities, errors and tests of its hypotheses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.samples import (
    HeldOut,
    HeldOutPart,
    Samples,
    cell_errors,
    error,
    leave_out,
    predicted,
    rmse,
)
from qlvbayes.diagnosis.checks.structure import Adequacy, Remainder, adequacy, remainder
from qlvbayes.diagnosis.decision import probabilities, require, sum_by_key
from qlvbayes.diagnosis.prior import log_odds_of_effect
from qlvbayes.diagnosis.result import (
    Alternative,
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

REPORTED = 0.02
"""Probability (odds of 50 to 1) below which something is not reported."""
_SETS = 3  # sets of effects that are reported as not ruled out
_ALTERNATIVES = 10  # hypotheses that are reported
_NEGLIGIBLE = 10.0  # log posterior behind the best from which averages leave a hypothesis out

Figure = TypeVar("Figure")


def _once(
    compute: Callable[[SearchOutcome, Candidate], Figure],
) -> Callable[[SearchOutcome, Candidate], Figure]:
    """Compute a figure of a candidate once for each hypothesis."""
    known: str = compute.__name__

    @wraps(compute)
    def kept(self: SearchOutcome, candidate: Candidate) -> Figure:
        figures = self.figures.setdefault(known, {})
        if candidate.hypothesis not in figures:
            figures[candidate.hypothesis] = compute(self, candidate)
        return figures[candidate.hypothesis]

    return kept


class SearchOutcome:
    """The posterior over the H hypotheses of one search, and figures of any of them.

    ``candidates``, ``weights`` and ``shares`` (H,) hold each hypothesis, its weight and its
    probability, ``draws`` (D, H) the probabilities within the errors of the evidences,
    ``unpredicted`` the hypotheses that predict no finite force at some samples. Effects that are
    ``measured`` in the records beyond doubt are in every hypothesis that counts, where the search
    knows one with all of them.
    """

    def __init__(self, experiment: Experiment, search: Search) -> None:
        self.experiment, self.search = experiment, search
        candidates = set(search.families.nameable) - search.baseline.effects
        self.measured = candidates.intersection(search.measured)
        point = self.baseline.point
        model = point.own.model_at(point.constants)
        self.samples = Samples.from_experiment(experiment, search.density.space, model)
        self.candidates = list(search.candidates.values())
        known = search.weights()
        self.without_evidence = sum(not weight.counts for weight in known)
        self.weights = require(known, self.measured)
        self.logs = np.array([weight.log_posterior for weight in self.weights])
        self.draws = probabilities(self.weights)
        self.shares = self.draws.mean(axis=0)
        self.unpredicted: set[Hypothesis] = set()
        self.figures: dict[str, dict[Hypothesis, Any]] = {}

    @property
    def baseline(self) -> Candidate:
        """The model of the user's choices."""
        return self.search.modes[self.search.baseline][0]

    @cached_property
    def alike(self) -> tuple[str, ...]:
        """Effects that follow the largest depth, where only one test loads, and only once.

        They are distinguished by how they grow with that depth. One test that loads to one depth
        does not show this: it then hangs on the elastic law alone which of them is probable.
        """
        return OF_UNLOADING if loaded_once(self.experiment) else ()

    @_once
    def left_out(self, candidate: Candidate) -> list[HeldOut]:
        """Return what a candidate predicts of each part by a fit to all others."""
        return predicted(self.samples, self._parts, candidate.mode)

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

    @_once
    def residuals(self, candidate: Candidate) -> list[Array]:
        """Return measured minus predicted force (N) of each test's samples."""
        residuals = self.samples.residuals(self.search.density, candidate.mode)
        if not all(np.isfinite(one).all() for one in residuals):
            self.unpredicted.add(candidate.hypothesis)
        return [
            np.where(np.isfinite(one), one, force)
            for one, force in zip(residuals, self.samples.observed, strict=True)
        ]

    @_once
    def adequacy(self, candidate: Candidate) -> Adequacy:
        """Return the adequacy test of a candidate."""
        record, cells = self.search.density.space.record, self.search.settings.cells
        return adequacy(self.experiment, record, candidate.point, cells)

    @_once
    def remainder(self, candidate: Candidate) -> Remainder:
        """Return the size of the structure that a candidate leaves."""
        residuals, test = self.residuals(candidate), self.adequacy(candidate)
        baseline = self.residuals(self.baseline)
        return remainder(self.samples, residuals, test, baseline, self.search.settings)

    def is_adequate(self, index: int) -> bool:
        """Return whether what a hypothesis leaves passes as noise or is small."""
        candidate, settings = self.candidates[index], self.search.settings
        tested, rest = self.adequacy(candidate), self.remainder(candidate)
        if tested.testable:
            return tested.is_sound(settings) or rest.small
        # how much the error of all samples exceeds the white noise
        white = [self.experiment.floor.white * own for own in self.samples.weights]
        noise = float(np.mean(np.concatenate(white) ** 2))
        beyond = math.sqrt(max(rmse(self.residuals(candidate)) ** 2 - noise, 0.0))
        return beyond <= settings.tolerance * self.experiment.scales.force

    def stage(self, candidate: Candidate) -> Stage:
        """Return the figures of one candidate."""
        residuals, tested = self.residuals(candidate), self.adequacy(candidate)
        level = 0.5 * self.search.settings.false_alarms / len(tested.cells)
        failing = [StructuredPhase(c.test, c.phase) for c in tested.cells if c.p_value < level]
        names, family = self.search.added(candidate.hypothesis), self.search.families.family_of
        return Stage(
            base=LawPair(*candidate.hypothesis.base),
            effects=tuple(sorted(names, key=lambda name: -self.inclusion(family[name]))),
            rmse=self.samples.error(residuals),
            heldout_rmse=finite_or_none(error(self.left_out(candidate))),
            log_evidence=finite_or_none(candidate.log_evidence),
            p_value=tested.p_value,
            testable=tested.testable,
            failing=tuple(dict.fromkeys(failing)),
            cells=tuple(cell_errors(self.samples, residuals)),
            parameters=self.estimates(candidate),
        )

    def inclusion(self, effect: str) -> float:
        """Return the probability that an effect is in the model, in any of its forms."""
        return self._share_of(self.having(effect))

    def having(self, effect: str) -> NDArray[np.bool_]:
        """Return which hypotheses (H,) have an effect, in any of its forms."""
        return np.array([effect in weight.effects for weight in self.weights])

    def form(self, index: int, effect: str) -> str:
        """Return the form in which a hypothesis, by its index, has an effect."""
        return self.weights[index].forms.get(effect, effect)

    def _share_of(self, inside: NDArray[np.bool_]) -> float:
        """Return the total probability of some hypotheses, as a mask (H,)."""
        return min(float(self.shares[inside].sum()), 1.0)

    def estimates(self, candidate: Candidate) -> dict[str, Estimate]:
        """Return the constants of a candidate's model by name, by Laplace's approximation."""
        point = candidate.point
        covariance = candidate.evidence.covariance + candidate.evidence.spread
        spread = point.slopes @ covariance @ point.slopes.T
        sds = np.sqrt(np.maximum(np.diag(spread), 0.0))
        every = estimates_at(self.experiment.units, point, sds)
        return {name: one for name, one in every.items() if not name.startswith("noise.")}

    def ranking(self) -> list[tuple[Ranked, int]]:
        """Return ``none`` and every candidate effect, the most probable first.

        With each comes the index of the most probable hypothesis that has it.
        """
        chosen = self.search.baseline.effects
        names = [name for name in self.search.families.nameable if name not in chosen]
        prior_odds = log_odds_of_effect(len(names), self.search.settings)
        without_any = np.array([not weight.effects for weight in self.weights])
        ranked: list[tuple[float, Ranked, int]] = []
        for name in ("none", *names):
            inside = without_any if name == "none" else self.having(name)
            if inside.any():
                odds = _log_odds(self.logs, inside) - (0.0 if name == "none" else prior_odds)
                index = int(np.argmax(np.where(inside, self.logs, -np.inf)))
                ranked.append((odds, self._ranked(name, inside, odds, index), index))
        ranked.sort(key=lambda one: (-one[1].inclusion, -one[0]))
        return [(one, index) for _, one, index in ranked]

    def _ranked(self, name: str, inside: NDArray[np.bool_], odds: float, index: int) -> Ranked:
        """Return the entry of one effect, which the hypotheses in a mask (H,) contain."""
        best, prefix = self.candidates[index], f"{self.form(index, name)}."
        counts = np.array([max(len(weight.effects), 1) for weight in self.weights])
        return Ranked(
            effect=name,
            inclusion=self._share_of(inside),
            probability=float((self.shares / counts)[inside].sum()),
            log_bayes_factor=finite_or_none(odds),
            rmse=self.samples.error(self.residuals(best)),
            parameters=of_effect(self.estimates(best), prefix),
            inclusion_error=float(self.draws[:, inside].sum(axis=1).std()),
        )

    def constants(self, selected: Candidate) -> dict[str, Estimate]:
        """Return the constants of the base laws, averaged over all hypotheses with these laws."""
        base = selected.hypothesis.base
        same = [k for k, weight in enumerate(self.weights) if weight.base == base]
        least = self.logs[same].max() - _NEGLIGIBLE
        near = [k for k in same if self.logs[k] > least]
        every = [self.estimates(self.candidates[k]) for k in near]
        of_laws = [{name: one for name, one in own.items() if "." not in name} for own in every]
        return averaged(self.logs[near].tolist(), of_laws)

    def sets(self) -> tuple[NotRuledOut, ...]:
        """Return the sets of effects over all base laws, the most probable first."""
        pairs = zip((w.effects for w in self.weights), self.shares.tolist(), strict=True)
        best = list(sum_by_key(pairs).items())[:_SETS]
        return tuple(NotRuledOut(tuple(sorted(s)), p) for s, p in best if p >= REPORTED)

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
            if self.shares[k] >= REPORTED
        )


def estimates_at(units: UnitSystem, point: Point, sds: Array) -> dict[str, Estimate]:
    """Return every constant at a point by its name, with sds (P,) and its unit."""
    kinds = unit_kinds(point.own)
    return {
        name: Estimate(units.of(kind), float(value), float(sd))
        for name, kind, value, sd in zip(point.own.names, kinds, point.constants, sds, strict=True)
    }


def of_effect(constants: Mapping[str, Estimate], prefix: str) -> dict[str, Estimate]:
    """Return the constants whose names begin with ``prefix``, without it."""
    own = {name: one for name, one in constants.items() if name.startswith(prefix)}
    return {name.removeprefix(prefix): one for name, one in own.items()}


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
