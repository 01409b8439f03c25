"""A beam search over hypotheses: the likeliest ones, each with all that are one step away.

A neighbour has another law, an effect more, one less or in another form. Every one is optimised
from several starts: what it shares with its neighbour carried over, a new effect small and large,
its shape at several quantiles; those that come out best also with the relaxation drawn anew.
Neighbours do not wait for one another. What has been seen may be looked at at any time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np

from qlvbayes.diagnosis.crosschecks import Start, exchanged_starts, nested_starts
from qlvbayes.diagnosis.prior import Families, log_prior
from qlvbayes.diagnosis.settings import Breadth, Settings
from qlvbayes.diagnosis.weighed import Weighed, described, weigh
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import in_natural_amplitude
from qlvbayes.inference.importance import CLOSE, sampled_evidence
from qlvbayes.inference.modes import Mode, base_modes, distinct, find_modes, modes, redrawn_modes
from qlvbayes.inference.starts import amplitude_of, shapes, starts, transferred
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.io.runtime import cores
from qlvbayes.laws.scales import SHARE

Tell = Callable[[str], None]
One = TypeVar("One")

_HIGHER = 0.5  # log posterior, by which a mode must be higher to be another one
_OTHER_SEED = 1000  # beside the search's own: draws that were not used before
CHECKS = ("nested", "exchanged", "draws")


@dataclass
class Checks:
    """How often a check for missed modes was made, failed, and led to a likelier mode."""

    made: int = 0
    failed: int = 0
    higher: int = 0


@dataclass(eq=False)
class Search:
    """Hypotheses seen so far, each at its modes, about a density and the user's choice of laws."""

    density: Density
    settings: Settings
    usual: Hypothesis
    families: Families
    tell: Tell = lambda text: None
    seed: int = 0
    modes: dict[Hypothesis, list[Weighed]] = field(default_factory=dict)
    _tried: set[tuple[Hypothesis, Hypothesis]] = field(default_factory=set)
    _redrawn: set[Hypothesis] = field(default_factory=set)
    _sampled: set[Hypothesis] = field(default_factory=set)
    _expanded: set[Hypothesis] = field(default_factory=set)
    _formed: set[Hypothesis] = field(default_factory=set)
    _checked: set[Hypothesis] = field(default_factory=set)
    _drawn_again: set[Hypothesis] = field(default_factory=set)
    checks: dict[str, Checks] = field(default_factory=lambda: {name: Checks() for name in CHECKS})

    @property
    def breadth(self) -> Breadth:
        """How broadly it looks."""
        return self.settings.breadth

    @property
    def seen(self) -> dict[Hypothesis, Weighed]:
        """Every hypothesis at its likeliest mode."""
        return {hypothesis: found[0] for hypothesis, found in self.modes.items()}

    def log_posterior(self, hypothesis: Hypothesis) -> float:
        """Up to a constant; minus infinity of what was not seen."""
        if hypothesis not in self.modes:
            return -math.inf
        log = self.modes[hypothesis][0].log_evidence + self.log_prior(hypothesis)
        return log if math.isfinite(log) else -math.inf  # what is no number leads nowhere

    def log_prior(self, hypothesis: Hypothesis) -> float:
        """Of a hypothesis, with its laws and its set of effects."""
        space = self.density.space
        laws = (space.elastic, space.relaxation)
        return log_prior(hypothesis, self.usual, laws, self.families, self.settings)

    @property
    def best(self) -> Hypothesis:
        """The likeliest so far."""
        return max(self.modes, key=self.log_posterior)

    def added(self, hypothesis: Hypothesis) -> list[str]:
        """Effects besides those that the user put into the model."""
        return sorted(hypothesis.effects - self.usual.effects)

    def begin(self) -> None:
        """See the plain model, and take the priors by what each effect does in this motion.

        Raises NoFiniteForceError where no draw of the plain model's priors gives finite forces.
        """
        self.tell(f"the plain model, {described(self.usual)}")
        found = self._from_priors(self.usual)
        self._keep(self.usual, self._weighed(self.usual, found))
        if self.usual not in self.modes:
            raise NoFiniteForceError
        self.density = _in_proportion(self)
        del self.modes[self.usual]
        again: list[Mode] = []
        for mode in found[: self.breadth.modes]:
            theta = mode.point.theta
            again += find_modes(self.density, self.usual, theta, self._lowest, known=again)
        self._keep(self.usual, self._weighed(self.usual, again))
        self._redrawn.add(self.usual)

    def run(self) -> None:
        """Until all neighbours of the likeliest have been seen, and their evidences sampled.

        Raises NoFiniteForceError where no draw of the plain model's priors gives finite forces.
        """
        self.begin()
        self._expand_likeliest()
        while not self.ended_early and self._check():
            self._expand_likeliest()
        while self._sample_next():
            pass

    def _expand_likeliest(self) -> None:
        """Until all neighbours of the beam have been seen."""
        while not self.ended_early:
            best = self.best
            if left := [one for one in self.beam if one not in self._expanded]:
                self._expanded.add(left[0])
                self.tell(f"neighbours of {described(left[0])}")
                self.expand(left[0], self.neighbours(left[0]))
            elif self._leaves_more(best) and best not in self._formed:
                self._formed.add(best)
                self.tell(f"other forms of the effects of {described(best)}")
                self.expand(best, self.forms(best))
            else:
                break

    def _check(self) -> bool:
        """Look where a missed mode would be; whether one was found."""
        self.tell("checks for modes that were missed")
        some = [one for one in self.modes if one not in self._checked]
        near = self.log_posterior(self.best) - self.breadth.rival
        some = [one for one in some if self.log_posterior(one) > near]
        self._checked.update(some)
        return any([self._check_nested(some), self._check_exchanged(some), self._check_draws()])

    def _check_nested(self, some: Sequence[Hypothesis]) -> bool:
        """Evidences with and without an effect against the effect's posterior at nothing."""
        apart, tolerance, starts = self.breadth.apart, self.settings.tolerance, []
        for one in some:
            for effect in self.added(one):
                wanted = nested_starts(self.density, self.seen, one, effect, apart, tolerance)
                if wanted is not None:
                    self.checks["nested"].made += 1
                    self.checks["nested"].failed += len(wanted) > 0
                    starts += wanted
        return self._look_from("nested", starts)

    def _check_exchanged(self, some: Sequence[Hypothesis]) -> bool:
        """Hypotheses without an extra mode from those with it, each mode left out in turn."""
        starts = [
            start
            for one in some
            for start in exchanged_starts(self.density.space, self.modes[one][0], self.added(one))
        ]
        self.checks["exchanged"].made += len(starts)
        return self._look_from("exchanged", starts)

    def _check_draws(self) -> bool:
        """The likeliest from other draws of the relaxation than those that it was found by."""
        some = [one for one in self.beam if one not in self._drawn_again]
        self._drawn_again.update(some)
        before = {one: self.log_posterior(one) for one in some}
        self._redraw(some, seed=_OTHER_SEED)
        self.checks["draws"].made += len(some)
        return self._count_higher("draws", before)

    def _look_from(self, check: str, starts: Sequence[Start]) -> bool:
        """Optimise from where a check wants it; whether that led higher."""
        before = {start.hypothesis: self.log_posterior(start.hypothesis) for start in starts}

        def look(start: Start) -> list[Weighed]:
            known = [one.mode for one in self.modes.get(start.hypothesis, [])]
            args = self.density, start.hypothesis, start.theta, self._lowest
            return self._weighed(start.hypothesis, find_modes(*args, known=known))

        for start, found in zip(starts, _side_by_side(look, starts), strict=True):
            self._keep(start.hypothesis, found)
        return self._count_higher(check, before)

    def _count_higher(self, check: str, before: dict[Hypothesis, float]) -> bool:
        """Whether hypotheses are likelier than before; their neighbours may be looked at again."""
        higher = [one for one, log in before.items() if self.log_posterior(one) > log + _HIGHER]
        self.checks[check].higher += len(higher)
        self._expanded.difference_update(higher)
        self._checked.difference_update(higher)
        self._tried = {(base, one) for base, one in self._tried if base not in higher}
        return bool(higher)

    @property
    def beam(self) -> list[Hypothesis]:
        """The likeliest so far, as many as are expanded, that come near the best."""
        order = sorted(self.modes, key=self.log_posterior, reverse=True)
        least = self.log_posterior(order[0]) - self.breadth.near
        return [one for one in order[: self.breadth.beam] if self.log_posterior(one) > least]

    @property
    def ended_early(self) -> bool:
        """Whether so many hypotheses were seen that no more are looked for."""
        return len(self.modes) >= self.breadth.hypotheses

    def expand(self, hypothesis: Hypothesis, some: Sequence[Hypothesis]) -> None:
        """See neighbours of a hypothesis; the best few also from other relaxations."""
        if hypothesis not in self._redrawn:
            self._redraw([hypothesis])
        self._see_all(hypothesis, some)
        new = [one for one in some if one in self.modes and one not in self._redrawn]
        new.sort(key=self.log_posterior, reverse=True)
        self._redraw(new[: self.breadth.redrawn])

    def neighbours(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """Another law, an effect more, one less, or a listed one in the place of a form.

        Curves that are no law only where more than noise is left.
        """
        space, added = self.density.space, self.added(hypothesis)
        elastic = space.elastic if self._leaves_more(hypothesis) else self.listed
        found = [replace(hypothesis, elastic=name) for name in elastic]
        found += [replace(hypothesis, relaxation=name) for name in space.relaxation]
        if len(added) < self.breadth.effects:
            more = set(self.families.beside(hypothesis.effects))
            found += [hypothesis.plus(name) for name in self.families.listed if name in more]
        for name in added:
            less = hypothesis.less(name)
            found += [
                less,
                *(less.plus(own) for own in self._relatives(name) if self._is_listed(own)),
            ]
        return [one for one in dict.fromkeys(found) if one != hypothesis]

    def forms(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """An effect in another form, one more in any form, and what names nothing."""
        found = [
            hypothesis.less(name).plus(own)
            for name in self.added(hypothesis)
            for own in self._relatives(name)
        ]
        if len(self.added(hypothesis)) < self.breadth.effects:
            more = self.families.beside(hypothesis.effects)
            found += [hypothesis.plus(name) for name in more if not self._is_listed(name)]
        return [one for one in dict.fromkeys(found) if one != hypothesis]

    def _relatives(self, effect: str) -> list[str]:
        """Every form of an effect."""
        return self.families.members(self.families.of[effect])

    def _is_listed(self, effect: str) -> bool:
        return effect in self.families.listed

    def _leaves_more(self, hypothesis: Hypothesis) -> bool:
        """Whether it leaves more than noise, at its likeliest mode."""
        return self.modes[hypothesis][0].mode.size > 0.0

    @property
    def listed(self) -> list[str]:
        """Elastic laws that say what the elasticity is; the user's own does."""
        laws = self.density.space.elastic
        return [name for name in laws if laws[name].listed or name == self.usual.elastic]

    def see(self, hypothesis: Hypothesis, base: Hypothesis | None = None) -> None:
        """A hypothesis as a neighbour of one that was seen, by default of the plain model.

        The first one of all from its priors.
        """
        if self.modes:
            self._see_all(base or self.usual, [hypothesis])
        else:
            found = self._from_priors(hypothesis)
            self._keep(hypothesis, self._weighed(hypothesis, found))

    def _from_priors(self, hypothesis: Hypothesis) -> list[Mode]:
        """Modes from draws of all its priors."""
        starts, draws = self.breadth.starts, self.breadth.draws
        return base_modes(self.density, hypothesis, self.seed, starts, draws)

    def _see_all(self, base: Hypothesis, some: Sequence[Hypothesis]) -> None:
        """Hypotheses from what each has in common with one that was seen, side by side."""
        some = [one for one in some if one != base and (base, one) not in self._tried]
        self._tried.update((base, one) for one in some)
        look = partial(self._modes_beside, base, self._lowest)
        for hypothesis, found in zip(some, _side_by_side(look, some), strict=True):
            self._keep(hypothesis, found)

    def _modes_beside(
        self, base: Hypothesis, lowest: float, hypothesis: Hypothesis
    ) -> list[Weighed]:
        """Modes that are not known yet of a neighbour, from modes of the base."""
        known = [one.mode for one in self.modes.get(hypothesis, [])]
        point = self.modes[base][0].point
        breadth = self.breadth
        some = starts(
            self.density.space, point, hypothesis, breadth.shapes, (breadth.small, breadth.large)
        )
        if not known:
            bare = self.modes.get(replace(hypothesis, effects=self.usual.effects))
            own = self.density.space.parameters(hypothesis)
            if bare and bare[0].hypothesis.base != base.base:
                known_law = bare[0].point
                some.append(transferred(known_law.own, known_law.theta, own, some[0]))
            some = [own.within(start) for start in some]
        if known or len(some) == 1:  # known from another neighbour
            found = find_modes(self.density, hypothesis, some[0], lowest, known)
        else:
            found = modes(self.density, hypothesis, some, lowest, self.breadth.followed)
        return self._weighed(hypothesis, found)

    def _redraw(self, some: Sequence[Hypothesis], seed: int = 0) -> None:
        """Look for more modes of hypotheses from other relaxations, side by side."""
        self._redrawn.update(some)

        def look(hypothesis: Hypothesis) -> list[Weighed]:
            known = [one.mode for one in self.modes[hypothesis]]
            known.sort(key=lambda mode: mode.loss)
            draws = self.breadth.draws
            found = redrawn_modes(self.density, hypothesis, known, self.seed + seed, draws)
            return self._weighed(hypothesis, [mode for mode in found if mode not in known])

        for hypothesis, found in zip(some, _side_by_side(look, some), strict=True):
            self._keep(hypothesis, found)

    @property
    def _lowest(self) -> float:
        """Loss of the best so far."""
        return min((found[0].mode.loss for found in self.modes.values()), default=math.inf)

    def _weighed(self, hypothesis: Hypothesis, found: Iterable[Mode]) -> list[Weighed]:
        """Evidences about modes that are no farther behind the highest than counts."""
        some = distinct(found)
        near = [mode for mode in some if mode.loss < some[0].loss + self.breadth.far]
        tolerance = self.settings.tolerance
        weighed = [weigh(self.density, hypothesis, mode, tolerance) for mode in near]
        return [one for one in weighed if math.isfinite(one.log_evidence)]

    def _keep(self, hypothesis: Hypothesis, found: Sequence[Weighed]) -> None:
        known = self.modes.get(hypothesis, [])
        kept = sorted([*known, *found], key=lambda one: -one.log_evidence)[: self.breadth.modes]
        if kept:
            self.modes[hypothesis] = kept

    def _sample_next(self) -> bool:
        """Sample the evidence of the likeliest hypothesis that counts and was not sampled yet."""
        near = self.log_posterior(self.best) - self.breadth.rival
        left = [one for one in self.modes if one not in self._sampled]
        left = [one for one in left if self.log_posterior(one) > near]
        if not left or len(self._sampled) >= self.breadth.sampled:
            return False
        one = max(left, key=self.log_posterior)
        self.tell(f"evidence of {described(one)}")
        self._sampled.add(one)
        first, *others = self.modes[one]
        pairs = [(weighed.mode, weighed.evidence) for weighed in (first, *others)]
        gap = self.log_posterior(self.best) - self.log_posterior(one)  # what is small may be vague
        close = CLOSE * (1.0 + gap)
        found = sampled_evidence(self.density, pairs, self.settings.tolerance, close)
        for mode, _ in pairs:
            mode.point.separation.forget_but(mode.size)
        if found is not None:
            told = replace(first.evidence, by_size=found.by_size, log=found.log)
            sampled = replace(first, evidence=told, log_evidence=found.log, error=found.error)
            self.modes[one] = [sampled, *others]
        return True


def _side_by_side(look: Callable[[One], list[Weighed]], some: Sequence[One]) -> list[list[Weighed]]:
    """What is found of each hypothesis or start, as many at once as there are cores.

    Each is looked at by itself, so that the answer does not depend on their number: XLA and BLAS
    let other threads run.
    """
    with ThreadPoolExecutor(cores()) as threads:
        return list(threads.map(look, some))


def _in_proportion(search: Search) -> Density:
    """The density with every amplitude's prior such that its force has the same size.

    One sd adds 5 % of the largest force, at the plain model's mode, in the user's own motion. The
    discrepancy may have each effect's signature too: whatever is there and not listed looks like
    some of them, so that one is believed only where it is far larger than all else that is left.
    """
    density, usual, families = search.density, search.usual, search.families
    settings = search.settings
    space, signatures, factors = density.space, [], {}
    peak = density.discrepancy.peak
    for name in families.listed:
        hypothesis = usual.plus(name)
        own = space.parameters(hypothesis)
        amplitude = amplitude_of(own, name)
        if name in usual.effects or amplitude is None:  # the user's own, with a prior of its own
            continue
        starts = shapes(space, search.modes[usual][0].point, own, name)
        for start in dict.fromkeys(map(tuple, (starts[0], starts[-1]))):
            added = space.added_force(hypothesis, np.array(start), amplitude.number, amplitude.sd)
            largest = float(np.max(np.abs(added[space.real])))
            if largest > 0.0 and math.isfinite(largest):
                signatures.append(added / largest)
                factors[name] = float(
                    np.clip(SHARE * peak / largest, settings.narrowest, settings.widest)
                )
    # a form holds the listed law inside, with the same amplitude
    effects = {
        name: in_natural_amplitude(effect, factors[families.of[name]])
        for name, effect in space.effects.items()
        if families.of[name] in factors
    }
    return density.with_space(space.with_effects({**space.effects, **effects}), signatures)
