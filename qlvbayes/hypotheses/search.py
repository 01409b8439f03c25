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
from qlvbayes.inference.modes import Mode, base_modes, modes
from qlvbayes.inference.space import Hypothesis, Leaf, Parameters, median
from qlvbayes.priors.natural import Natural

Array = NDArray[np.float64]
Tell = Callable[[str], None]

_SHAPES = 4  # quantiles of a new effect's first constant besides its amplitude
_FOLLOWED = 2  # of these, that are optimised
_NEAR = 40.0  # log posterior behind the best, within which a law is tried with an effect less
_BEHIND = 30.0  # loss behind the best, at which a hypothesis is given up
_MOST_EFFECTS = 3


@dataclass(frozen=True, eq=False)
class Weighed:
    """A hypothesis at its likeliest mode: log evidence (with the smallest size that matters)."""

    hypothesis: Hypothesis
    mode: Mode
    evidence: Evidence
    log_evidence: float

    @property
    def point(self) -> Point:
        """The mode's place."""
        return self.mode.point


@dataclass(eq=False)
class Search:
    """Hypotheses seen so far, by a density, a prior, and the user's own choice of laws."""

    density: Density
    prior: HypothesisPrior
    usual: Hypothesis
    tell: Tell = lambda text: None
    seen: dict[Hypothesis, Weighed] = field(default_factory=dict)

    def log_posterior(self, hypothesis: Hypothesis) -> float:
        """Up to a constant; minus infinity of what was not seen."""
        if hypothesis not in self.seen:
            return -math.inf
        space = self.density.space
        laws = (space.elastic, space.relaxation)
        log_prior = self.prior.log(hypothesis, self.usual, laws, len(space.effects))
        return self.seen[hypothesis].log_evidence + log_prior

    @property
    def best(self) -> Hypothesis:
        """The likeliest so far."""
        return max(self.seen, key=self.log_posterior)

    def run(self) -> None:
        """Until the best hypothesis has no better neighbour."""
        for name in self.density.space.elastic:
            self.tell(f"elastic law {name}")
            self.see_plain(Hypothesis(name, self.usual.relaxation))
        grown: set[Hypothesis] = set()
        rebased: set[Hypothesis] = set()
        if self.usual in self.seen:
            self._grow(self.usual, grown)
        while self.seen:
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
        grown.add(hypothesis)
        self.tell(f"effects beside {described(hypothesis)}")
        if len(hypothesis.effects) < _MOST_EFFECTS:
            for name in self.density.space.effects:
                if name not in hypothesis.effects:
                    self.see_with(hypothesis, name)
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
        """A base law from its priors."""
        if hypothesis not in self.seen:
            self._keep(hypothesis, base_modes(self.density, hypothesis))

    def see_with(self, base: Hypothesis, effect: str) -> None:
        """One more effect, from the mode without it."""
        hypothesis = base.plus(effect)
        if hypothesis in self.seen:
            return
        found = []
        for start in self._with_effect(base, hypothesis, effect):
            point = self.density.at(hypothesis, start)
            if point is not None:
                found.append((evidence(self.density, point, linear=True).log, start))
        found.sort(key=lambda one: -one[0])
        starts = [start for _, start in found[:_FOLLOWED]]
        self._keep(hypothesis, self._optimised(hypothesis, starts))

    def see_without(self, base: Hypothesis, effect: str) -> None:
        """One effect less."""
        hypothesis = base.less(effect)
        if hypothesis not in self.seen:
            start, _ = self._carried(base, hypothesis)
            self._keep(hypothesis, self._optimised(hypothesis, [start]))

    def see_rebased(self, base: Hypothesis, hypothesis: Hypothesis) -> None:
        """The same effects on another law: from its own mode without them, and from its priors."""
        if hypothesis in self.seen:
            return
        if not hypothesis.effects:
            self.see_plain(hypothesis)
            return
        carried, filled = self._carried(base, hypothesis)
        bare = Hypothesis(hypothesis.elastic, hypothesis.relaxation)
        draws = self.density.space.plain_draws(bare)
        plain = [self.seen[bare].point.theta if bare in self.seen else median(draws)]
        starts = []
        for own in plain:
            start = carried.copy()
            start[: own.size] = own
            starts.append(start)
        mixed = np.where(filled, carried, starts[0])
        self._keep(hypothesis, self._optimised(hypothesis, [*starts, mixed]))

    def _optimised(self, hypothesis: Hypothesis, starts: Iterable[Array]) -> list[Mode]:
        lowest = min((one.mode.loss for one in self.seen.values()), default=math.inf)
        return modes(self.density, hypothesis, starts, lowest + _BEHIND)

    def _keep(self, hypothesis: Hypothesis, found: Iterable[Mode]) -> None:
        weighed = [weigh(self.density, hypothesis, mode) for mode in found]
        real = [one for one in weighed if math.isfinite(one.log_evidence)]
        if real:
            self.seen[hypothesis] = max(real, key=lambda one: one.log_evidence)

    def _carried(self, base: Hypothesis, hypothesis: Hypothesis) -> tuple[Array, NDArray[np.bool_]]:
        """Theta (F,) with the numbers that both have, at the base's mode, and which those are."""
        space = self.density.space
        old, new = space.parameters(base), space.parameters(hypothesis)
        numbers, theta = _by_name(old), self.seen[base].point.theta
        found, filled = np.zeros(new.size), np.zeros(new.size, dtype=bool)
        for name, leaf in _by_name(new).items():
            if name in numbers and len(numbers[name].theta) == len(leaf.theta):
                found[list(leaf.theta)] = theta[list(numbers[name].theta)]
                filled[list(leaf.theta)] = True
        return found, filled

    def _with_effect(self, base: Hypothesis, hypothesis: Hypothesis, effect: str) -> list[Array]:
        """Starts (F,): the effect at nothing, its first other constant over its prior."""
        space = self.density.space
        start, filled = self._carried(base, hypothesis)
        own = [leaf for leaf in space.parameters(hypothesis).leaves if not filled[leaf.theta[0]]]
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
