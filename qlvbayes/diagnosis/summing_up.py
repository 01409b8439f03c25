"""From a finished search to all that is told of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from qlvbayes.carried import carried_notices, clock_notices
from qlvbayes.diagnosis.adequacy import Adequacy, adequacy
from qlvbayes.diagnosis.averaging import averaged
from qlvbayes.diagnosis.decision import LEFT, Decision, Weight, decide, inside, less, unless_sound
from qlvbayes.diagnosis.design import suggest
from qlvbayes.diagnosis.heldout import held_out
from qlvbayes.diagnosis.prior import log_odds_of_effect
from qlvbayes.diagnosis.protocol import protocol_of
from qlvbayes.diagnosis.remainder import Remainder, remainder
from qlvbayes.diagnosis.samples import Samples, cell_errors, rmse
from qlvbayes.diagnosis.search import Search, Tell, Weighed
from qlvbayes.diagnosis.sensitivity import (
    bends,
    coincident,
    responses,
    unmeasured,
    unseen,
)
from qlvbayes.diagnosis.verdict import (
    Alternative,
    Base,
    Diagnosis,
    Estimate,
    NotRuledOut,
    Ranked,
    Stage,
    Work,
)
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.experiment import Experiment
from qlvbayes.inference.space import Hypothesis
from qlvbayes.parameters import unit_kinds
from qlvbayes.records.record import Record
from qlvbayes.unresolved import unresolved_times

Array = NDArray[np.float64]

RISES = "tests left out are predicted worse with it"
IMITATES = "it takes less of the error than what no effect of the list explains, and may imitate it"
_LISTED = 3  # sets of effects that are told as not ruled out
_LEAST = 0.02  # probability of one that is told: 50 to 1
_ALTERNATIVES = 10  # hypotheses told


class Summing:
    """One search's posterior, and what follows from it; every figure is computed once."""

    def __init__(self, experiment: Experiment, search: Search, tell: Tell) -> None:
        self.experiment, self.search, self.tell = experiment, search, tell
        self.samples = Samples.of(experiment, search.density.space)
        self.seen = list(search.seen.values())
        sizes, peak = search.density.discrepancy.sizes, experiment.scales.force
        limit = search.settings.tolerance * peak
        self.weights = [
            Weight(
                (one.hypothesis.elastic, one.hypothesis.relaxation),
                frozenset(search.added(one.hypothesis)),
                search.log_posterior(one.hypothesis),
                one.evidence.probability_above(sizes, limit),
            )
            for one in self.seen
        ]
        self.shares = softmax([weight.log_posterior for weight in self.weights])
        self._heldout: dict[Hypothesis, float] = {}
        self._residuals: dict[Hypothesis, list[Array]] = {}
        self._tested: dict[Hypothesis, Adequacy] = {}

    def decided(self) -> tuple[Decision, tuple[tuple[str, str], ...]]:
        """The decision after both vetoes, and effects refused with the reason."""
        settings = self.search.settings
        decision = decide(self.weights, settings)
        if decision.verdict in LEFT and self._is_enough(self.seen[decision.told]):
            decision = inside(decision, self.weights, settings)
        told = self.seen[decision.told]
        self.tell("tests left out")
        refused = [(name, RISES) for name in decision.tried if self._rises(told, name)]
        decision = less(decision, self.weights, [name for name, _ in refused])
        self.tell("testing what is left")
        told = self.seen[decision.told]
        decision = unless_sound(decision, self.weights, sound=self._is_enough(told))
        if decision.verdict == "partly_explained":
            small = [
                (name, IMITATES) for name in decision.effects if self._takes_little(told, name)
            ]
            decision = less(decision, self.weights, [name for name, _ in small])
            decision = unless_sound(decision, self.weights, sound=False)
            refused += small
        return decision, tuple(refused)

    def _is_enough(self, told: Weighed) -> bool:
        """Whether what a hypothesis leaves passes as noise or is small.

        Where no rest shows whether noise is correlated, single cells say nothing: all over then.
        """
        tested, left = self.tested(told), self.left(told)
        little = not tested.testable and left.excess <= left.tolerance * left.peak
        return tested.is_sound(self.search.settings) or left.is_small or little

    def _without(self, told: Weighed, effect: str) -> Weighed | None:
        """A hypothesis less one of its effects; None if it has not got it."""
        if effect not in told.hypothesis.effects:
            return None
        self.search.see_without(told.hypothesis, effect)
        found = self.search.modes.get(told.hypothesis.less(effect))
        return found[0] if found else None

    def _rises(self, told: Weighed, effect: str) -> bool:
        """Whether tests left out are predicted worse with an effect than without."""
        without = self._without(told, effect)
        if without is None:
            return False
        limit = (1.0 + self.search.settings.rise) * self.heldout(without)
        return bool(self.heldout(told) > limit)

    def _takes_little(self, told: Weighed, effect: str) -> bool:
        """Whether an effect takes less of the squared error than what no effect explains.

        Then it may as well imitate a part of that.
        """
        without = self._without(told, effect)
        if without is None:
            return False
        return bool(self.left(without).excess ** 2 < 2.0 * self.left(told).excess ** 2)

    def heldout(self, found: Weighed) -> float:
        """Error on tests left out (N)."""
        if found.hypothesis not in self._heldout:
            error = held_out(self.search.density, self.samples, found).rmse
            self._heldout[found.hypothesis] = error
        return self._heldout[found.hypothesis]

    def residuals(self, found: Weighed) -> list[Array]:
        """Measured minus predicted force of each trial's samples (N)."""
        if found.hypothesis not in self._residuals:
            residuals = self.samples.residuals(found.hypothesis, found.point.constants)
            self._residuals[found.hypothesis] = residuals
        return self._residuals[found.hypothesis]

    def tested(self, found: Weighed) -> Adequacy:
        """Whether structure is left."""
        if found.hypothesis not in self._tested:
            record = self.search.density.space.record
            self._tested[found.hypothesis] = adequacy(self.experiment, record, found.point)
        return self._tested[found.hypothesis]

    def left(self, found: Weighed) -> Remainder:
        """Size of what a hypothesis leaves."""
        residuals, test = self.residuals(found), self.tested(found)
        plain = self.residuals(self.search.modes[self.search.usual][0])
        peak, settings = self.experiment.scales.force, self.search.settings
        return remainder(self.samples, residuals, test, plain, peak=peak, settings=settings)

    def path(self, told: Weighed) -> tuple[Weighed, ...]:
        """From the plain model that was chosen, by the told one's laws, effect after effect."""
        search = self.search
        hypothesis = replace(told.hypothesis, effects=search.usual.effects)
        search.see_plain(hypothesis)
        steps = [search.usual, hypothesis]
        left = set(search.added(told.hypothesis))
        while len(left) > 1:
            for name in left:
                search.see_rebased(told.hypothesis, steps[-1].plus(name))
            best = max(left, key=lambda name: search.log_posterior(steps[-1].plus(name)))
            steps.append(steps[-1].plus(best))
            left.remove(best)
        steps.append(told.hypothesis)
        known = [one for one in dict.fromkeys(steps) if one in search.modes]
        return tuple(search.modes[one][0] for one in known)

    def stage(self, found: Weighed) -> Stage:
        """One hypothesis in figures."""
        residuals, tested = self.residuals(found), self.tested(found)
        level = 0.5 * self.search.settings.false_alarms / len(tested.cells)
        return Stage(
            base=(found.hypothesis.elastic, found.hypothesis.relaxation),
            effects=tuple(self._ordered(found)),
            rmse=rmse(residuals),
            heldout_rmse=self.heldout(found),
            log_evidence=found.log_evidence,
            p_value=tested.p_value,
            testable=tested.testable,
            sound=tested.is_sound(self.search.settings),
            cells=tuple(cell_errors(self.samples, residuals)),
            failing=tuple((c.test, c.phase) for c in tested.cells if c.p_value < level),
            parameters=self.estimates(found, lambda name: not name.startswith("noise.")),
        )

    def _ordered(self, found: Weighed) -> list[str]:
        """Its effects, the surest first."""
        names = self.search.added(found.hypothesis)
        return sorted(names, key=lambda name: -self.inclusion(name))

    def inclusion(self, effect: str) -> float:
        """Probability that an effect is in the model."""
        inside = [effect in weight.effects for weight in self.weights]
        return min(float(self.shares @ np.array(inside, dtype=float)), 1.0)

    def estimates(self, found: Weighed, wanted: Callable[[str], bool]) -> dict[str, Estimate]:
        """Constants at a mode, by Laplace's approximation."""
        point, kinds = found.point, unit_kinds(found.point.own.posterior)
        spread = point.slopes @ found.evidence.covariance @ point.slopes.T
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
        candidates = [n for n in self.search.density.space.effects if self._is_added(n)]
        prior = log_odds_of_effect(len(candidates), self.search.settings)
        logs = np.array([weight.log_posterior for weight in self.weights])
        ranked = []
        for name in ("none", *candidates):
            inside = np.array(
                [not w.effects if name == "none" else name in w.effects for w in self.weights]
            )
            if not inside.any():
                continue
            best = self.seen[int(np.argmax(np.where(inside, logs, -np.inf)))]
            odds = _log_odds(logs, inside) - (0.0 if name == "none" else prior)
            own = self.estimates(best, partial(_starts, f"{name}."))
            found = {key.removeprefix(f"{name}."): value for key, value in own.items()}
            share = min(float(self.shares[inside].sum()), 1.0)
            counts = np.array([max(len(weight.effects), 1) for weight in self.weights])
            alone = float((self.shares / counts)[inside].sum())
            ranked.append(Ranked(name, share, alone, odds, rmse(self.residuals(best)), found))
        return tuple(sorted(ranked, key=lambda one: (-one.inclusion, -one.log_bayes_factor)))

    def _is_added(self, name: str) -> bool:
        return name not in self.search.usual.effects

    def constants(self, told: Weighed) -> dict[str, Estimate]:
        """The base law's, averaged over all hypotheses on the same laws."""
        base = (told.hypothesis.elastic, told.hypothesis.relaxation)
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
        return tuple(NotRuledOut(tuple(sorted(s)), p) for s, p in best if p >= _LEAST)

    def alternatives(self) -> tuple[Alternative, ...]:
        """Single hypotheses, the likeliest first."""
        order = np.argsort(-self.shares)[:_ALTERNATIVES]
        return tuple(
            Alternative(
                self.weights[k].base, tuple(sorted(self.weights[k].effects)), float(self.shares[k])
            )
            for k in order
            if self.shares[k] >= _LEAST
        )


def summed_up(
    experiment: Experiment,
    search: Search,
    kinds: Sequence[type[AbstractEffect]],
    bonded: bool,
    tell: Tell,
) -> Diagnosis:
    """All that is told of a finished search."""
    summing = Summing(experiment, search, tell)
    decision, refused = summing.decided()
    told = summing.seen[decision.told]
    path = summing.path(told)
    tell("what these tests cannot show")
    plain = search.modes[search.usual][0]
    protocol = protocol_of(experiment, bonded=bonded)
    added = responses(search, plain)
    bases = tuple(Base(*laws, share) for laws, share in decision.base.items() if share >= _LEAST)
    own = (told.hypothesis.elastic, told.hypothesis.relaxation)
    candidates = [kind for kind in kinds if kind.name not in search.usual.effects]
    stages = tuple(summing.stage(one) for one in path)
    return Diagnosis(
        pad=experiment.pad,
        noise=experiment.floor.total,
        verdict=decision.verdict,
        effects=decision.tried,
        group=decision.group,
        base=Base(*own, decision.base[own]),
        bases=bases,
        stages=stages,
        ranking=summing.ranking(),
        alternatives=summing.alternatives(),
        outside=decision.outside,
        not_identifiable=(
            *unseen(added, search, protocol),
            *unmeasured(candidates, protocol),
        ),
        bends=tuple(bends(added, plain)),
        coincident=tuple(coincident(added)),
        refused=refused,
        suggestions=_suggestions(summing, decision),
        work=Work(
            experiment,
            search,
            summing.samples,
            path,
            tuple(summing.tested(one) for one in path),
        ),
        discrepancy=told.mode.size,
        not_ruled_out=summing.sets() if decision.verdict != "unexplained" else (),
        constants=summing.constants(told),
        remainder=summing.left(told),
        notices=_notices(experiment, search, told),
    )


def _log_odds(logs: Array, inside: NDArray[np.bool_]) -> float:
    if inside.all():
        return math.inf
    return float(logsumexp(logs[inside]) - logsumexp(logs[~inside]))


def _suggestions(summing: Summing, decision: Decision) -> tuple:
    """Tests that would tell the members of a group apart."""
    rest = set(decision.effects)
    points = []
    for name in decision.group:
        same = [
            (weight.log_posterior, k)
            for k, weight in enumerate(summing.weights)
            if weight.effects == rest | {name}
        ]
        if same:
            points.append(summing.seen[max(same)[1]])
    found = suggest(summing.experiment, summing.search.density, points) if len(points) > 1 else []
    return tuple(found)


def _notices(experiment: Experiment, search: Search, told: Weighed) -> tuple[str, ...]:
    """What the tests have from each other, by the hypothesis told."""
    space = search.density.space
    constants = told.point.constants

    def predict(record: Record) -> Array:
        return space.forces(told.hypothesis, constants[None], record)[0]

    carried = carried_notices(experiment, experiment.trials, space.record, predict)
    clock = () if experiment.rested else clock_notices(experiment)
    model = told.point.own.posterior.with_constants(jnp.asarray(constants))[0]
    times = unresolved_times(model.relaxation, experiment.scales)
    said = [f"pad {experiment.pad}: {text}" for text in (*experiment.floor.notices, *times)]
    return (*carried, *clock, *said)


def _is_plain(name: str) -> bool:
    return "." not in name


def _starts(prefix: str, name: str) -> bool:
    return name.startswith(prefix)
