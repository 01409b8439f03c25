"""A beam search over hypotheses: the most probable ones are expanded to all their neighbours.

A neighbour has another law, one effect more, one effect less, or an effect in another form. Where
the most probable hypothesis of all leaves structure, its effects are also replaced by others, and
the effects that the record shows without any model are added in each of their forms.
Each is optimised from several starts: the constants that it shares with the hypothesis it came from
are kept. A new effect's force is tried small and large, at several quantiles of its shape's prior,
and starts where it promises most. An extra mode of the relaxation may have taken the part of one
that the law has: without it, each mode of the spectrum is left out in turn. The best few are also
optimised from relaxations that are drawn anew. The neighbours of one hypothesis are optimised in
parallel. The state of a search may be read at any time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from qlvbayes.diagnosis.candidate import Candidate, candidate_at, described
from qlvbayes.diagnosis.decision import Weight
from qlvbayes.diagnosis.prior import Families, log_prior, scale_amplitudes
from qlvbayes.diagnosis.settings import Breadth, DiagnosisSettings
from qlvbayes.effects.contacts import ContactOffset
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import Mode, base_modes, distinct, find_modes, modes, redrawn_modes
from qlvbayes.inference.starts import exchanged_starts, starts, transferred
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.io.runtime import in_threads

Report = Callable[[str], None]


@dataclass(eq=False)
class Search:
    """The hypotheses evaluated so far, with their modes, and the beam that adds to them."""

    density: Density  # posterior density of any hypothesis on the pad's tests
    settings: DiagnosisSettings  # prior probabilities, thresholds and the breadth of the search
    # the hypothesis that the user chose: laws, and effects that every hypothesis has
    baseline: Hypothesis
    families: Families  # families of the effects that may be added
    # is called with a line of text before each step that takes a while
    report: Report = lambda text: None
    seed: int = 0
    # effects that the record shows beyond doubt without any model
    measured: frozenset[str] = frozenset()
    # returns the density with what errors of measured contacts change about a point; None where no
    # contact was measured
    about: Callable[[Density, Point], Density] | None = None
    # up to ``settings.breadth.modes`` candidates of each hypothesis, the highest first
    modes: dict[Hypothesis, list[Candidate]] = field(default_factory=dict)
    _tried: set[tuple[Hypothesis, Hypothesis]] = field(default_factory=set)
    _redrawn: set[Hypothesis] = field(default_factory=set)
    _expanded: set[Hypothesis] = field(default_factory=set)
    _forms_tried: set[str] = field(default_factory=set)
    _substituted: set[Hypothesis] = field(default_factory=set)

    @property
    def breadth(self) -> Breadth:
        """Breadth of the search for hypotheses and modes."""
        return self.settings.breadth

    @property
    def candidates(self) -> dict[Hypothesis, Candidate]:
        """Every hypothesis evaluated, at its highest mode."""
        return {hypothesis: own[0] for hypothesis, own in self.modes.items()}

    @property
    def best(self) -> Hypothesis:
        """The most probable hypothesis so far."""
        return max(self.modes, key=self.log_posterior)

    @property
    def lowest_loss(self) -> float:
        """Loss of the best mode so far; infinity before there is one."""
        return min((own[0].mode.loss for own in self.modes.values()), default=math.inf)

    @property
    def ended_early(self) -> bool:
        """True if so many hypotheses were evaluated that the search stops."""
        return len(self.modes) >= self.breadth.hypotheses

    @property
    def nameable_laws(self) -> list[str]:
        """Elastic laws that say what the elasticity is; a law that the user chose always does."""
        laws = self.density.space.elastic
        return [name for name in laws if laws[name].listed or name == self.baseline.elastic]

    def log_posterior(self, hypothesis: Hypothesis) -> float:
        """Return the log posterior up to a constant; minus infinity if it was not evaluated."""
        if hypothesis not in self.modes:
            return -math.inf
        log = self.modes[hypothesis][0].log_evidence + self.log_prior(hypothesis)
        return log if math.isfinite(log) else -math.inf  # nothing is expanded from a nan

    def log_prior(self, hypothesis: Hypothesis) -> float:
        """Return the log prior probability of a hypothesis: of its laws and its set of effects."""
        space = self.density.space
        laws = (space.elastic, space.relaxation)
        return log_prior(hypothesis, self.baseline, laws, self.families, self.settings)

    def added(self, hypothesis: Hypothesis) -> list[str]:
        """Return the effects in addition to those that the user put into the model, sorted."""
        return sorted(hypothesis.effects - self.baseline.effects)

    def without(self, candidate: Candidate, family: str) -> Candidate | None:
        """Return a candidate without one of its effects, which is evaluated now if it was not."""
        own = self.added(candidate.hypothesis)
        form = next((name for name in own if self.families.family_of[name] == family), None)
        if form is None:
            return None
        less = candidate.hypothesis.less(form)
        self.evaluate(less, candidate.hypothesis)
        return self.candidates.get(less)

    def weights(self) -> list[Weight]:
        """Return the weight of every hypothesis evaluated, in the order of ``candidates``."""
        discrepancy = self.density.discrepancy
        limit = self.settings.tolerance * discrepancy.peak
        return [
            Weight(
                one.hypothesis.base,
                frozenset(self.added(one.hypothesis)),
                self.log_posterior(one.hypothesis),
                one.evidence.probability_above(discrepancy.sizes, limit),
                one.hypothesis.elastic in self.nameable_laws,
                error=one.error,
            )
            .made_finite()
            .within(self.families)
            for one in self.candidates.values()
        ]

    def begin(self) -> None:
        """Evaluate the baseline model, and scale the priors of all amplitudes with it."""
        self.report(f"the plain model, {described(self.baseline)}")
        drawn = self._modes_from_priors(self.baseline)
        self.keep(self.baseline, self.candidates_from(self.baseline, drawn))
        if self.baseline not in self.modes:
            raise NoFiniteForceError
        point = self.modes[self.baseline][0].point
        self.density = scale_amplitudes(
            self.density, self.baseline, point, self.families, self.settings
        )
        del self.modes[self.baseline]
        again: list[Mode] = []
        for mode in drawn[: self.breadth.modes]:
            theta = mode.point.theta
            again += find_modes(self.density, self.baseline, theta, self.lowest_loss, known=again)
        self.keep(self.baseline, self.candidates_from(self.baseline, again))
        self._redrawn.add(self.baseline)

    def expand_beam(self) -> None:
        """Evaluate the neighbours of the beam until those of all its hypotheses are known."""
        while not self.ended_early:
            best = self.best
            if self.about and best.elastic != self.baseline.elastic:
                self._move_about()
                continue
            leaves = self._leaves_structure(best)
            if leaves and (new := {*self.added(best), *self._lacks(best)} - self._forms_tried):
                self._forms_tried |= new
                self._expand_to("forms of the effects of", best, self.forms(best, new))
            elif left := [one for one in self.beam if one not in self._expanded]:
                self._expanded.add(left[0])
                self._expand_to("neighbours of", left[0], self.neighbours(left[0]))
            elif leaves and best not in self._substituted:
                self._substituted.add(best)
                others = [*self.forms(best), *self.with_unlisted(best), *self.substitutions(best)]
                self._expand_to("other effects instead of those of", best, others)
            else:
                break

    def _move_about(self) -> None:
        """Linearise the errors of contacts about the best hypothesis, and find all modes again.

        Below a law that rises from nothing a contact that is off changes less than below the
        baseline's. This is done once, when a law is more probable than the baseline's.
        """
        assert self.about is not None
        known, self.modes = self.modes, {}
        offsets = set(self.families.members(ContactOffset.name))
        exact = [own[0] for one, own in known.items() if not one.effects & offsets]
        nearest = max(exact, key=lambda one: one.log_evidence + self.log_prior(one.hypothesis))
        self.density, self.about = self.about(self.density, nearest.point), None

        def look(hypothesis: Hypothesis) -> list[Candidate]:
            found: list[Mode] = []
            for one in known[hypothesis]:
                theta = one.mode.point.theta
                found += find_modes(self.density, hypothesis, theta, math.inf, known=found)
            return self.candidates_from(hypothesis, found)

        self._keep_each(look, list(known))

    def _lacks(self, hypothesis: Hypothesis) -> frozenset[str]:
        """Return the effects that the record shows and a hypothesis has in no form."""
        if len(self.added(hypothesis)) >= self.breadth.effects:
            return frozenset()
        return self.measured.intersection(self.families.addable(hypothesis.effects))

    def _expand_to(self, how: str, hypothesis: Hypothesis, some: Sequence[Hypothesis]) -> None:
        """Evaluate some neighbours of a hypothesis, if there are any, and report it."""
        if some:
            self.report(f"{how} {described(hypothesis)}")
            self.expand(hypothesis, some)

    @property
    def beam(self) -> list[Hypothesis]:
        """The hypotheses to expand: the most probable ones that come near the best."""
        order = sorted(self.modes, key=self.log_posterior, reverse=True)
        least = self.log_posterior(order[0]) - self.breadth.near
        return [one for one in order[: self.breadth.beam] if self.log_posterior(one) > least]

    def expand(self, hypothesis: Hypothesis, neighbours: Sequence[Hypothesis]) -> None:
        """Evaluate neighbours of a hypothesis; the best few also from other relaxations."""
        if hypothesis not in self._redrawn:
            self.redraw([hypothesis])
        self._evaluate_all(hypothesis, neighbours)
        new = [one for one in neighbours if one in self.modes and one not in self._redrawn]
        new.sort(key=self.log_posterior, reverse=True)
        self.redraw(new[: self.breadth.redrawn])

    def neighbours(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """Return the hypotheses with another law, or one candidate effect more or less."""
        space, added, nameable = self.density.space, self.added(hypothesis), self.families.nameable
        elastic = space.elastic if self._leaves_structure(hypothesis) else self.nameable_laws
        some = [replace(hypothesis, elastic=name) for name in elastic]
        some += [replace(hypothesis, relaxation=name) for name in space.relaxation]
        grown = any(
            replace(one, relaxation=hypothesis.relaxation) == hypothesis
            for one in self._expanded - {hypothesis}
        )
        if len(added) < self.breadth.effects and not grown:
            more = set(self.families.addable(hypothesis.effects))
            some += [hypothesis.plus(name) for name in nameable if name in more]
        for name in added:
            less = hypothesis.less(name)
            some += [
                less,
                *(less.plus(own) for own in self.families.relatives(name) if own in nameable),
            ]
        return [one for one in dict.fromkeys(some) if one != hypothesis]

    def forms(
        self, hypothesis: Hypothesis, effects: Collection[str] | None = None
    ) -> list[Hypothesis]:
        """Return the hypotheses with one effect, of some or all of them, in another form.

        Some effects that the hypothesis has not are added to it, in every form.
        """
        some = [
            hypothesis.less(name).plus(own)
            for name in (self.added(hypothesis) if effects is None else sorted(effects))
            for own in self.families.relatives(name)
        ]
        return [one for one in dict.fromkeys(some) if one != hypothesis]

    def with_unlisted(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """Return the hypotheses with one more effect that is a form, or names nothing."""
        if len(self.added(hypothesis)) >= self.breadth.effects:
            return []
        more = self.families.addable(hypothesis.effects)
        return [hypothesis.plus(name) for name in more if name not in self.families.nameable]

    def substitutions(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """Return the hypotheses with one effect replaced by another one."""
        others = [name for name in self.families.nameable if name not in hypothesis.effects]
        others.sort(key=self._largest_gain, reverse=True)
        return [
            less.plus(other)
            for less in map(hypothesis.less, self.added(hypothesis))
            for other in others[: self.breadth.substitutes]
            if other in self.families.addable(less.effects)
        ]

    def _largest_gain(self, effect: str) -> float:
        """Return the largest rise of the log posterior when an effect was added to a hypothesis."""
        logs = {one: log for one in self.modes if math.isfinite(log := self.log_posterior(one))}
        having = [(one, log) for one, log in logs.items() if effect in one.effects]
        gains = [log - logs[less] for one, log in having if (less := one.less(effect)) in logs]
        return max(gains, default=-math.inf)

    def _leaves_structure(self, hypothesis: Hypothesis) -> bool:
        """Return whether a hypothesis leaves more than noise at its highest mode."""
        return self.modes[hypothesis][0].mode.size > 0.0

    def evaluate(self, hypothesis: Hypothesis, base: Hypothesis | None = None) -> None:
        """Find the modes of a hypothesis, starting from those of one that was evaluated."""
        if self.modes:
            self._evaluate_all(base or self.baseline, [hypothesis])
        else:
            drawn = self._modes_from_priors(hypothesis)
            self.keep(hypothesis, self.candidates_from(hypothesis, drawn))

    def _modes_from_priors(self, hypothesis: Hypothesis) -> list[Mode]:
        """Return the modes that draws of all its priors lead to."""
        count, draws = self.breadth.starts, self.breadth.draws
        starts = self.density.space.prior_draws(hypothesis, self.seed)[:count]
        return base_modes(self.density, hypothesis, starts, self.seed, draws)

    def _evaluate_all(self, base: Hypothesis, some: Sequence[Hypothesis]) -> None:
        """Find modes of hypotheses in parallel, from those of one that was evaluated."""
        some = [one for one in some if one != base and (base, one) not in self._tried]
        self._tried.update((base, one) for one in some)
        look = partial(self._candidates_from_base, base, self.lowest_loss)
        self._keep_each(look, some)

    def _candidates_from_base(
        self, base: Hypothesis, lowest: float, hypothesis: Hypothesis
    ) -> list[Candidate]:
        """Return candidates of a neighbour that are not known yet, from modes of the base."""
        known = [one.mode for one in self.modes.get(hypothesis, [])]
        point, size = self.modes[base][0].point, self.modes[base][0].mode.size
        breadth = self.breadth
        sizes = breadth.small, breadth.large
        some = starts(
            self.density.space, point, hypothesis, breadth.shapes, sizes, breadth.optimised
        )
        if not known:
            bare = self.modes.get(replace(hypothesis, effects=self.baseline.effects))
            own = self.density.space.parameters(hypothesis)
            if bare and bare[0].hypothesis.base != base.base:
                known_law = bare[0].point
                some.append(transferred(known_law.own, known_law.theta, own, some[0]))
            some = [own.within(start) for start in some]
        exchanged = exchanged_starts(self.density.space, point, hypothesis)
        if known or len(some) == 1:  # it was evaluated as the neighbour of another one before
            new: list[Mode] = []
            for start in (some[0], *exchanged):
                new += find_modes(self.density, hypothesis, start, lowest, [*known, *new], size)
        else:
            some += exchanged
            new = modes(self.density, hypothesis, some, lowest, 1, size)
        return self.candidates_from(hypothesis, new)

    def redraw(self, some: Sequence[Hypothesis]) -> None:
        """Look for more modes of hypotheses in parallel, from other draws of the relaxation."""
        self._redrawn.update(some)

        def look(hypothesis: Hypothesis) -> list[Candidate]:
            known = [one.mode for one in self.modes[hypothesis]]
            known.sort(key=lambda mode: mode.loss)
            draws = self.breadth.draws
            new = redrawn_modes(self.density, hypothesis, known, self.seed, draws)
            return self.candidates_from(hypothesis, [mode for mode in new if mode not in known])

        self._keep_each(look, some)

    def candidates_from(self, hypothesis: Hypothesis, some: Iterable[Mode]) -> list[Candidate]:
        """Return candidates at those of some modes that come near the highest of them."""
        apart = distinct(some)
        near = [mode for mode in apart if mode.loss < apart[0].loss + self.breadth.far]
        tolerance = self.settings.tolerance
        new = [candidate_at(self.density, hypothesis, mode, tolerance) for mode in near]
        return [one for one in new if math.isfinite(one.log_evidence)]

    def _keep_each(
        self, look: Callable[[Hypothesis], list[Candidate]], some: Sequence[Hypothesis]
    ) -> None:
        """Look for candidates of hypotheses in parallel, and keep them in order."""
        for hypothesis, new in zip(some, in_threads(look, some), strict=True):
            self.keep(hypothesis, new)

    def keep(self, hypothesis: Hypothesis, new: Sequence[Candidate]) -> None:
        """Add candidates of a hypothesis to its modes, of which only the highest are kept."""
        known = self.modes.get(hypothesis, [])
        kept = sorted([*known, *new], key=lambda one: -one.log_evidence)[: self.breadth.modes]
        if kept:
            self.modes[hypothesis] = kept
