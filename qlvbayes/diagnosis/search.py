"""One loop over neighbours: an effect more, one less, another law, until the best stays the best.

A hypothesis is optimised from the mode of the one it neighbours, its new numbers at several
quantiles of their priors, those first whose linearised evidence promises most. What falls
hopelessly behind on its way is given up. What has been seen may be looked at at any time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.prior import Families, log_prior
from qlvbayes.diagnosis.promises import Promise, promised, screened
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.weighed import Weighed, described, weigh
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.extending import amplitude_of, carried, shapes
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import in_natural_amplitude, median
from qlvbayes.inference.importance import CLOSE, sampled_evidence
from qlvbayes.inference.modes import (
    BEHIND,
    Mode,
    base_modes,
    distinct,
    find_modes,
    modes,
)
from qlvbayes.inference.projection import projected
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.laws.scales import SHARE

Array = NDArray[np.float64]
Tell = Callable[[str], None]

_FOLLOWED = 2  # shapes of a new effect, that are optimised
_SCREENED = 2  # effects that follow the data best under coarse noise, tried in any case
_MODES = 4  # of a hypothesis, that are kept to start its neighbours from
_NEAR = 25.0  # log posterior behind the best, within which an effect more or less may lead;
_FARTHER = 40.0  # the same where the best leaves more than noise, of what is grown or set on others
_RIVAL = 7.0  # the same of what counts beside it (a thousandth): its effects go on all such laws
_FACTORS = (0.2, 5.0)  # by which a prior is fitted to the motion: beyond, nothing can be seen
_MOST_EFFECTS = 3
_MOST_SEEN = 150  # hypotheses: beside something that no list holds very many are alike
_MOST_SAMPLED = 12  # hypotheses whose evidence is sampled: what comes after is told by Laplace's


@dataclass(eq=False)
class Search:
    """Hypotheses seen so far, each at its modes, about a density and the user's choice of laws."""

    density: Density
    settings: Settings
    usual: Hypothesis
    families: Families
    tell: Tell = lambda text: None
    modes: dict[Hypothesis, list[Weighed]] = field(default_factory=dict)
    _lessened: set[tuple[Hypothesis, str]] = field(default_factory=set)
    _sampled: set[Hypothesis] = field(default_factory=set)

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

    def _may_lead(self, base: Hypothesis, one: Promise) -> bool:
        """Whether what an effect more promises comes near the best.

        Beside a base that leaves only noise nothing can bring much more than it promises.
        """
        promised = one.log_evidence + self.log_prior(one.hypothesis)
        window = _NEAR if self._leaves_more(base) else _RIVAL
        return promised > self.log_posterior(self.best) - window

    def _leaves_more(self, hypothesis: Hypothesis) -> bool:
        """Whether it leaves more than noise, at its likeliest mode."""
        return self.modes[hypothesis][0].mode.size > 0.0

    @property
    def _window(self) -> float:
        """Log posterior behind the best, within which laws and fewer effects are looked at."""
        return _FARTHER if self._leaves_more(self.best) else _NEAR

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
        self.see_plain(self.usual)
        if self.usual not in self.modes:
            raise NoFiniteForceError
        self.density = _in_proportion(self)
        known = [one.mode.point.theta for one in self.modes.pop(self.usual)]
        self._keep(self.usual, self._optimised(self.usual, known))

    def run(self) -> None:
        """Until the best hypothesis has no better neighbour.

        Raises NoFiniteForceError where no draw of the plain model's priors gives finite forces.
        """
        self.begin()
        self._see_bases()
        grown: set[Hypothesis] = set()
        rebased: set[Hypothesis] = set()
        formed: set[Hypothesis] = set()
        while not self.ended_early:
            best = self.best
            if self.added(best) and best not in rebased:
                rebased.add(best)
                self.tell(f"other laws of {described(best)}")
                for neighbour in self._other_laws(best):
                    self.see_rebased(best, neighbour)
            elif best not in grown:
                self._grow(best, grown)
            elif self._leaves_more(best) and best not in formed:
                formed.add(best)
                self._see_forms(best)
            elif others := [*self._exchanges(best, grown), *self.simpler(grown)]:
                self._grow(others[0], grown)
            elif crossed := self.crossed(best):
                self.tell("likely effects on likely laws")
                for found, neighbour in crossed:
                    self.see_rebased(found, neighbour)
            else:
                break
        while self._sample_next():
            pass

    @property
    def ended_early(self) -> bool:
        """Whether so many hypotheses were seen that no more are looked for."""
        return len(self.modes) >= _MOST_SEEN

    def _sample_next(self) -> bool:
        """Sample the evidence of the likeliest hypothesis that counts and was not sampled yet."""
        near = self.log_posterior(self.best) - _RIVAL
        left = [one for one in self.modes if one not in self._sampled]
        left = [one for one in left if self.log_posterior(one) > near]
        if not left or len(self._sampled) >= _MOST_SAMPLED:
            return False
        one = max(left, key=self.log_posterior)
        self.tell(f"evidence of {described(one)}")
        self._sampled.add(one)
        first, *others = self.modes[one]
        pairs = [(weighed.mode, weighed.evidence) for weighed in (first, *others)]
        gap = self.log_posterior(self.best) - self.log_posterior(one)  # what is small may be vague
        close = CLOSE * (1.0 + gap)
        found = sampled_evidence(self.density, pairs, self.settings.tolerance, close)
        if found is not None:
            told = replace(first.evidence, by_size=found.by_size, log=found.log)
            sampled = replace(first, evidence=told, log_evidence=found.log, error=found.error)
            self.modes[one] = [sampled, *others]
        return True

    def crossed(self, best: Hypothesis) -> list[tuple[Hypothesis, Hypothesis]]:
        """Likely sets of effects on other laws that come near, where not seen: from, and what."""
        top = self.log_posterior(best)
        ordered = sorted(self.modes, key=self.log_posterior, reverse=True)
        near = [one for one in ordered if self.log_posterior(one) > top - self._window]
        sets: dict[frozenset[str], Hypothesis] = {}
        for one in near:
            few = len(one.effects) <= len(best.effects)
            if few and self.log_posterior(one) > top - _RIVAL:
                sets.setdefault(one.effects, one)
        bases = dict.fromkeys(one.base for one in near)
        return [
            (found, Hypothesis(*base, effects))
            for effects, found in sets.items()
            for base in bases
            if Hypothesis(*base, effects) not in self.modes
        ]

    def _exchanges(self, best: Hypothesis, grown: set[Hypothesis]) -> list[Hypothesis]:
        """The best without one of its effects: grown, they have another in its place."""
        fewer = [best.less(effect) for effect in self.added(best)]
        return [one for one in fewer if one in self.modes and one not in grown]

    def _see_bases(self) -> None:
        """Laws without effects: elastic ones, then relaxations of the likeliest.

        Effects are looked for on the likeliest: on a wrong law several imitate the right one.
        """
        self.tell("elastic laws")
        for name in self.listed:
            self.see_plain(replace(self.usual, elastic=name))
        best = self.best
        self.tell(f"relaxations of {described(best)}")
        for name in self.density.space.relaxation:
            self.see_plain(replace(best, relaxation=name))
        if self.best != best:
            for name in self.listed:
                self.see_plain(replace(self.best, elastic=name))
        self._see_near(self.usual)  # its best mode should not be one that its starts happened on
        for name in sorted(self.density.space.relaxing & set(self.families.listed)):
            self._see_spectrum(replace(self.best, relaxation=self.usual.relaxation), name)

    def _see_near(self, hypothesis: Hypothesis) -> None:
        """From where its laws come nearest to the likeliest ones."""
        known = self.modes[self.best][0].point
        if known.own.hypothesis == hypothesis:
            return
        self._see_from(known, hypothesis)

    def _see_from(self, known: Point, hypothesis: Hypothesis, others: Array | None = None) -> Array:
        """From a point's numbers, others (F,), and laws as like its own as they can be.

        Returns the start (F,) before its laws were fitted.
        """
        own = self.density.space.parameters(hypothesis)
        start = carried(known.own, known.theta, own, others)
        near = projected(self.density.space, known, hypothesis, start)
        self._keep(hypothesis, self._optimised(hypothesis, [near]))
        return start

    def _see_spectrum(self, bare: Hypothesis, effect: str) -> None:
        """The chosen relaxation with what acts on it alone, as near as it comes to the best one.

        One mode more may be all that it lacks, and yet promise nothing beside a mode without it.
        """
        if bare in self.modes and effect not in self.usual.effects and self.best != bare:
            self._see_near(bare.plus(effect))

    def simpler(self, grown: set[Hypothesis]) -> list[Hypothesis]:
        """On other laws, with fewer effects than the best, those that more may bring up to it."""
        best = self.best
        likeliest: dict[tuple[str, str], Hypothesis] = {}
        for one in sorted(self.modes, key=self.log_posterior):
            likeliest[one.base] = one
        found = [
            one
            for one in likeliest.values()
            if one not in grown
            and len(one.effects) < len(best.effects)
            and self.log_posterior(one) > self.log_posterior(best) - self._window
        ]
        return sorted(found, key=self.log_posterior, reverse=True)

    def _grow(self, hypothesis: Hypothesis, grown: set[Hypothesis]) -> None:
        """Every effect more, the most promising first, and every effect less."""
        grown.add(hypothesis)
        self.tell(f"effects beside {described(hypothesis)}")
        if len(self.added(hypothesis)) < _MOST_EFFECTS:
            self._add(hypothesis, self.families.listed)
        for name in self.added(hypothesis):
            self.see_without(hypothesis, name)

    def _add(self, hypothesis: Hypothesis, effects: Iterable[str]) -> None:
        """Each of some effects more, of families that are not in yet."""
        free = set(self.families.beside(hypothesis.effects))
        names = [name for name in effects if name in free]
        self._add_promising(hypothesis, names)
        if self._leaves_more(hypothesis):
            self._add_screened(hypothesis, names)
        for name in names:
            self._add_unknown(hypothesis, name)

    def _add_promising(self, hypothesis: Hypothesis, names: Sequence[str]) -> None:
        """Those whose linearised evidence comes near the best, the most promising first."""
        for one in self._promises(hypothesis, names):
            if self._may_lead(hypothesis, one):
                start = self.density.extended(one.point, one.added)
                if start is not None:
                    self._keep(one.hypothesis, self._optimised(one.hypothesis, [start]))

    def _add_screened(self, hypothesis: Hypothesis, names: Sequence[str]) -> None:
        """The few that follow the data best under coarse noise, whatever they promise."""
        known = self.modes[hypothesis][0]
        for mode in screened(self.density, known, names, self.settings.tolerance)[:_SCREENED]:
            more = mode.point.own.hypothesis
            if more not in self.modes:
                self._keep(more, self._optimised(more, [mode.point.theta]))

    def _add_unknown(self, hypothesis: Hypothesis, name: str) -> None:
        """An effect of the user's own, whose prior may be of any kind: nothing is promised."""
        more = hypothesis.plus(name)
        own = self.density.space.parameters(more)
        if amplitude_of(own, name) is None:
            starts = shapes(self.density.space, self.modes[hypothesis][0].point, own, name)
            few = starts[:: len(starts) // _FOLLOWED or 1]
            self._keep(more, self._optimised(more, few))

    def _see_forms(self, hypothesis: Hypothesis) -> None:
        """Where something is left: other forms of effects, and what names nothing."""
        self.tell(f"other forms of the effects of {described(hypothesis)}")
        listed = set(self.families.listed)
        others = [name for name in self.families.of if name not in listed]
        if len(self.added(hypothesis)) < _MOST_EFFECTS:
            self._add(hypothesis, others)
        for effect in self.added(hypothesis):
            family = self.families.of[effect]
            fewer = hypothesis.less(effect)
            if fewer in self.modes:
                self._add(fewer, [name for name in self.families.members(family) if name != effect])

    def _other_laws(self, hypothesis: Hypothesis) -> Iterator[Hypothesis]:
        """Its effects on every other law, and without them: a law may be what they imitate.

        On what comes near, also with an effect less.
        """
        space, effects = self.density.space, self.added(hypothesis)
        elastic_ones = space.elastic if self._leaves_more(hypothesis) else self.listed
        bases = [(name, hypothesis.relaxation) for name in elastic_ones]
        bases += [(hypothesis.elastic, name) for name in space.relaxation]
        for elastic, relaxation in bases:
            yield Hypothesis(elastic, relaxation, self.usual.effects)
            other = Hypothesis(elastic, relaxation, hypothesis.effects)
            yield other
            if self.log_posterior(other) > self.log_posterior(self.best) - self._window:
                yield from (other.less(effect) for effect in effects)

    @property
    def listed(self) -> list[str]:
        """Elastic laws that say what the elasticity is; the user's own does."""
        laws = self.density.space.elastic
        return [name for name in laws if laws[name].listed or name == self.usual.elastic]

    def see_plain(self, hypothesis: Hypothesis) -> None:
        """A base law from its priors, and from what others found that share a part of it."""
        if hypothesis in self.modes:
            return
        if not self.modes:
            self._keep(hypothesis, base_modes(self.density, hypothesis))
            return
        middle = median(self.density.space.plain_draws(hypothesis))
        bare = [one for one in self.modes if one.effects == hypothesis.effects]
        same = [one for one in bare if one.relaxation == hypothesis.relaxation]
        known = self.modes[max(same or bare, key=self.log_posterior)][0].point
        start = self._see_from(known, hypothesis, middle)
        if self._is_near(hypothesis):
            self._keep(hypothesis, modes(self.density, hypothesis, [start], self._lowest))

    def _promises(self, base: Hypothesis, names: Sequence[str]) -> list[Promise]:
        """Of each of some effects more the places that promise most, at the base's modes."""
        followed = _FOLLOWED if self._leaves_more(base) else 1
        return promised(self.density, self.modes[base], names, followed)

    def see_without(self, base: Hypothesis, effect: str) -> None:
        """One effect less."""
        if (base, effect) in self._lessened:
            return
        self._lessened.add((base, effect))
        hypothesis = base.less(effect)
        found = self.modes[base][0]
        known, own = found.point, self.density.space.parameters(hypothesis)
        start = carried(known.own, known.theta, own)
        sizes = (None, found.mode.size)
        self._keep(hypothesis, self._optimised(hypothesis, [start], sizes))

    def see_rebased(self, base: Hypothesis, hypothesis: Hypothesis) -> None:
        """The same effects on another law: from its own modes, with those effects or none of them.

        What stands for an effect on one law may be far from what it is on another.
        """
        if hypothesis in self.modes:
            return
        bare = replace(hypothesis, effects=self.usual.effects)
        self.see_plain(bare)
        if hypothesis == bare or bare not in self.modes:
            return
        found, nothing = self.modes[base][0].point, self._without_effects(hypothesis)
        self._see_from(found, hypothesis, nothing)
        if self._is_near(hypothesis):
            self._keep(hypothesis, self._optimised(hypothesis, [nothing]))

    def _is_near(self, hypothesis: Hypothesis) -> bool:
        """Whether another start may bring it to what counts, as far as the first tells."""
        if hypothesis not in self.modes:
            return True
        return self.modes[hypothesis][0].mode.loss < self._lowest + 2.0 * BEHIND

    def _without_effects(self, hypothesis: Hypothesis) -> Array:
        """Theta (F,) of a bare law's mode, every effect at nothing and as promises most there."""
        bare = replace(hypothesis, effects=self.usual.effects)
        own, point = self.density.space.parameters(hypothesis), self.modes[bare][0].point
        theta = np.zeros(own.size)
        for effect in self.added(hypothesis):
            for one in self._promises(bare, [effect])[:1]:
                theta = carried(one.added.own, one.added.theta, own, theta)
        return carried(point.own, point.theta, own, theta)

    def _optimised(
        self,
        hypothesis: Hypothesis,
        starts: Iterable[Array | Point],
        sizes: Sequence[float | None] = (None,),
    ) -> list[Mode]:
        """Modes known and found from some places, with a discrepancy of some sizes (N) at first."""
        found = [one.mode for one in self.modes.get(hypothesis, [])]
        for start in starts:
            found += find_modes(self.density, hypothesis, start, self._lowest, sizes, found)
        return found

    @property
    def _lowest(self) -> float:
        """Loss of the best so far."""
        return min((found[0].mode.loss for found in self.modes.values()), default=math.inf)

    def _keep(self, hypothesis: Hypothesis, found: Iterable[Mode]) -> None:
        tolerance = self.settings.tolerance
        weighed = [weigh(self.density, hypothesis, mode, tolerance) for mode in distinct(found)]
        real = [one for one in weighed if math.isfinite(one.log_evidence)]
        known = self.modes.get(hypothesis, [])
        kept = sorted([*known, *real], key=lambda one: -one.log_evidence)[:_MODES]
        if kept:
            self.modes[hypothesis] = kept


def _in_proportion(search: Search) -> Density:
    """The density with every amplitude's prior such that its force has the same size.

    One sd adds 5 % of the largest force, at the plain model's mode, in the user's own motion. The
    discrepancy may have each effect's signature too: whatever is there and not listed looks like
    some of them, so that one is believed only where it is far larger than all else that is left.
    """
    density, usual, families = search.density, search.usual, search.families
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
                factors[name] = float(np.clip(SHARE * peak / largest, *_FACTORS))
    # a form holds the listed law inside, with the same amplitude
    effects = {
        name: in_natural_amplitude(effect, factors[families.of[name]])
        for name, effect in space.effects.items()
        if families.of[name] in factors
    }
    return density.with_space(space.with_effects({**space.effects, **effects}), signatures)
