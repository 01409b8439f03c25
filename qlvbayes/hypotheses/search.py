"""One loop over neighbours: an effect more, one less, another law, until the best stays the best.

A hypothesis is optimised from the mode of the one it neighbours, its new numbers at several
quantiles of their priors, those first whose linearised evidence promises most. What falls
hopelessly behind on its way is given up. What has been seen may be looked at at any time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.noticeable import log_noticeable
from qlvbayes.hypotheses.prior import HypothesisPrior
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.evidence import Evidence, evidence
from qlvbayes.inference.modes import Mode, base_modes, distinct, find_mode, modes
from qlvbayes.inference.space import Hypothesis, Leaf, Parameters, median
from qlvbayes.priors.natural import Natural

Array = NDArray[np.float64]
Tell = Callable[[str], None]

_SHAPES = 4  # quantiles of a new effect's first constant besides its amplitude
_FOLLOWED = 2  # of these, that are optimised
_MODES = 4  # of a hypothesis, that are kept to start its neighbours from
_NEAR = 40.0  # log posterior behind the best, within which a law is tried with an effect less
_BEHIND = 30.0  # loss behind the best, at which a hypothesis is given up
_MOST_EFFECTS = 3


@dataclass(frozen=True, eq=False)
class Weighed:
    """A hypothesis at one of its modes: log evidence (with the smallest size that matters)."""

    hypothesis: Hypothesis
    mode: Mode
    evidence: Evidence
    log_evidence: float

    @property
    def point(self) -> Point:
        """The mode's place."""
        return self.mode.point


@dataclass(frozen=True, eq=False)
class _Start:
    """Where a hypothesis is to be optimised from, and what its evidence promises to be there."""

    hypothesis: Hypothesis
    theta: Array
    log_evidence: float


@dataclass(eq=False)
class Search:
    """Hypotheses seen so far, by a density, a prior, and the user's own choice of laws."""

    density: Density
    prior: HypothesisPrior
    usual: Hypothesis
    tell: Tell = lambda text: None
    modes: dict[Hypothesis, list[Weighed]] = field(default_factory=dict)

    @property
    def seen(self) -> dict[Hypothesis, Weighed]:
        """Every hypothesis at its likeliest mode."""
        return {hypothesis: found[0] for hypothesis, found in self.modes.items()}

    def log_posterior(self, hypothesis: Hypothesis) -> float:
        """Up to a constant; minus infinity of what was not seen."""
        if hypothesis not in self.modes:
            return -math.inf
        space = self.density.space
        laws = (space.elastic, space.relaxation)
        log_prior = self.prior.log(hypothesis, self.usual, laws, len(space.effects))
        return self.modes[hypothesis][0].log_evidence + log_prior

    @property
    def best(self) -> Hypothesis:
        """The likeliest so far."""
        return max(self.modes, key=self.log_posterior)

    def run(self) -> None:
        """Until the best hypothesis has no better neighbour."""
        self.see_plain(self.usual)
        for name in self.density.space.elastic:
            self.tell(f"elastic law {name}")
            self.see_plain(Hypothesis(name, self.usual.relaxation))
        grown: set[Hypothesis] = set()
        rebased: set[Hypothesis] = set()
        if self.usual in self.modes:
            self._grow(self.usual, grown)
        while self.modes:
            best = self.best
            if best not in grown:
                self._grow(best, grown)
            elif best not in rebased:
                rebased.add(best)
                self.tell(f"other laws of {described(best)}")
                for neighbour in self._other_laws(best):
                    self.see_rebased(best, neighbour)
            else:
                return

    def _grow(self, hypothesis: Hypothesis, grown: set[Hypothesis]) -> None:
        """Every effect more, the most promising first, and every effect less."""
        grown.add(hypothesis)
        self.tell(f"effects beside {described(hypothesis)}")
        if len(hypothesis.effects) < _MOST_EFFECTS:
            added = [name for name in self.density.space.effects if name not in hypothesis.effects]
            starts = [start for name in added for start in self._promising(hypothesis, name)]
            for one in sorted(starts, key=lambda one: -one.log_evidence):
                self._keep(one.hypothesis, self._optimised(one.hypothesis, [one.theta]))
        for name in hypothesis.effects:
            self.see_without(hypothesis, name)

    def _other_laws(self, hypothesis: Hypothesis) -> Iterator[Hypothesis]:
        """On every other law; any relaxation where something is left, else a mode more or less.

        On what comes near, also with an effect less: a law may be what an effect imitated.
        """
        space = self.density.space
        own, names = hypothesis.relaxation, list(space.relaxation)
        left = self.seen[hypothesis].mode.size > 0.0
        pairs = [(name, own) for name in space.elastic]
        for name in names:
            beside = own.startswith("prony") and abs(names.index(name) - names.index(own)) == 1
            if left or (beside and name.startswith("prony")):
                pairs.append((hypothesis.elastic, name))
        for elastic, relaxation in pairs:
            other = Hypothesis(elastic, relaxation, hypothesis.effects)
            yield other
            if self.log_posterior(other) > self.log_posterior(self.best) - _NEAR:
                for effect in hypothesis.effects:
                    yield other.less(effect)

    def see_plain(self, hypothesis: Hypothesis) -> None:
        """A base law from its priors, and from what others found that share a part of it."""
        if hypothesis in self.modes:
            return
        alike = [one for one in self.modes if hypothesis.relaxation == one.relaxation]
        if not alike:
            self._keep(hypothesis, base_modes(self.density, hypothesis))
            return
        middle = median(self.density.space.plain_draws(hypothesis))
        starts = [self._with_carried(one, hypothesis, middle) for one in self.modes[alike[0]]]
        self._keep(hypothesis, modes(self.density, hypothesis, [middle, *starts]))

    def _promising(self, base: Hypothesis, effect: str) -> list[_Start]:
        """Places to add an effect from, at the base's mode, by linearised evidence."""
        hypothesis = base.plus(effect)
        found = []
        for one in self.modes[base]:
            for theta in self._with_effect(one, hypothesis, effect):
                point = self.density.at(hypothesis, theta)
                if point is not None:
                    log = evidence(self.density, point, linear=True).log
                    found.append(_Start(hypothesis, theta, log))
        return sorted(found, key=lambda one: -one.log_evidence)[:_FOLLOWED]

    def see_without(self, base: Hypothesis, effect: str) -> None:
        """One effect less."""
        hypothesis = base.less(effect)
        nothing = np.zeros(self.density.space.parameters(hypothesis).size)
        start = self._with_carried(self.modes[base][0], hypothesis, nothing)
        self._keep(hypothesis, self._optimised(hypothesis, [start]))

    def see_rebased(self, base: Hypothesis, hypothesis: Hypothesis) -> None:
        """The same effects on another law: from its own mode without them, and from its priors."""
        if hypothesis in self.modes:
            return
        if not hypothesis.effects:
            self.see_plain(hypothesis)
            return
        bare = Hypothesis(hypothesis.elastic, hypothesis.relaxation)
        own = median(self.density.space.plain_draws(bare))
        plain = [one.point.theta for one in self.modes.get(bare, [])] or [own]
        found = self.modes[base][0]
        size = self.density.space.parameters(hypothesis).size
        starts = []
        for theta in plain:
            start = self._with_carried(found, hypothesis, np.zeros(size))
            start[: theta.size] = theta
            starts.append(start)
        mixed = self._with_carried(found, hypothesis, starts[0])
        self._keep(hypothesis, self._optimised(hypothesis, [*starts, mixed]))

    def _optimised(self, hypothesis: Hypothesis, starts: Iterable[Array]) -> list[Mode]:
        lowest = min((found[0].mode.loss for found in self.modes.values()), default=math.inf)
        found = [find_mode(self.density, hypothesis, start, lowest + _BEHIND) for start in starts]
        return [mode for mode in found if mode is not None]

    def _keep(self, hypothesis: Hypothesis, found: Iterable[Mode]) -> None:
        weighed = [weigh(self.density, hypothesis, mode) for mode in distinct(found)]
        real = [one for one in weighed if math.isfinite(one.log_evidence)]
        known = self.modes.get(hypothesis, [])
        kept = sorted([*known, *real], key=lambda one: -one.log_evidence)[:_MODES]
        if kept:
            self.modes[hypothesis] = kept

    def _with_carried(self, found: Weighed, hypothesis: Hypothesis, others: Array) -> Array:
        """Theta (F,) with the numbers that a mode has too; others (F,): those that it lacks."""
        old, new = found.point.own, self.density.space.parameters(hypothesis)
        numbers, theta = _by_name(old), others.copy()
        for name, leaf in _by_name(new).items():
            if name in numbers and len(numbers[name].theta) == len(leaf.theta):
                theta[list(leaf.theta)] = found.point.theta[list(numbers[name].theta)]
        return theta

    def _with_effect(self, found: Weighed, hypothesis: Hypothesis, effect: str) -> list[Array]:
        """Starts (F,): the effect at nothing, its first other constant over its prior."""
        space, new = self.density.space, self.density.space.parameters(hypothesis)
        start = self._with_carried(found, hypothesis, np.zeros(new.size))
        own = [leaf for name, leaf in _by_name(new).items() if name.startswith(f"{effect}.")]
        draws, taken, shapes = space.draws("effects", effect), 0, []
        for leaf in own:
            if not isinstance(leaf.prior, Natural):
                shapes.append((leaf, draws[:, taken : taken + len(leaf.theta)]))
            taken += len(leaf.theta)
        starts = []
        for k in range(_SHAPES if shapes else 1):
            moved = start.copy()
            for order, (leaf, values) in enumerate(shapes):
                share = (k + 0.5) / _SHAPES if order == 0 else 0.5
                moved[list(leaf.theta)] = np.quantile(values, share, axis=0)
            starts.append(moved)
        return starts


def weigh(density: Density, hypothesis: Hypothesis, mode: Mode) -> Weighed:
    """Evidence about a mode, of effects large enough to matter."""
    found = evidence(density, mode.point)
    log = found.log
    for leaf in mode.point.own.leaves:
        if isinstance(leaf.prior, Natural) and math.isfinite(log):
            k = leaf.theta[0]
            sd = math.sqrt(max(found.covariance[k, k], 0.0))
            log += log_noticeable(leaf.prior.inner, float(found.mean[k]), sd)
    return Weighed(hypothesis, mode, found, log)


def described(hypothesis: Hypothesis) -> str:
    """As ``exponential, prony:2 + friction``."""
    laws = f"{hypothesis.elastic}, {hypothesis.relaxation}"
    return " + ".join((laws, *sorted(hypothesis.effects)))


def _by_name(own: Parameters) -> dict[str, Leaf]:
    return {own.names[leaf.constants.start]: leaf for leaf in own.leaves}
