r"""Checks for modes that the search missed. They do not need to know the true model.

*Nested hypotheses.* With an amplitude a whose prior is pi, the evidences of a hypothesis H + effect
and of H must keep

.. math:: \frac{Z_{H + e}}{Z_H} = \frac{\pi(0)}{p(a = 0 \mid data, H + e)}

(Savage-Dickey; Dickey 1971, doi:10.1214/aoms/1177693507). The check is made where the effect's
posterior reaches zero amplitude: farther out no density there is known. Where it fails, one of the
two hypotheses was left at a lower mode, and each is optimised from the other's mode.

*Exchangeable modes.* An extra mode of the relaxation may have taken the part of one that the law
has: H is optimised from the spectrum of H + mode with each relaxation mode left out in turn.

*Other draws.* The most probable hypotheses are optimised from relaxations that the search has not
drawn before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.search import Search, in_parallel
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.inference.amplitude_prior import log_noticeable
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.fixedrates import relaxation_of
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import FEW, Space
from qlvbayes.inference.modes import find_modes
from qlvbayes.inference.projection import with_curve
from qlvbayes.inference.starts import amplitude_of, over_shapes, transferred
from qlvbayes.io.arrays import Array

_OTHER_SEED = 1000  # added to the search's seed, for draws that it has not used before


class Start(NamedTuple):
    """A start, theta (F,), from which a check wants a hypothesis to be optimised."""

    hypothesis: Hypothesis
    theta: Array


class MissedModeChecks:
    """The checks for missed modes of one search; ``search.checks`` counts what they do."""

    def __init__(self, search: Search) -> None:
        self._search = search
        self._checked: set[Hypothesis] = set()
        self._redrawn: set[Hypothesis] = set()

    def run(self) -> bool:
        """Make all checks of the hypotheses that count; return whether a higher mode was found."""
        search = self._search
        search.report("checks for modes that were missed")
        some = [one for one in search.modes if one not in self._checked]
        near = search.log_posterior(search.best) - search.breadth.rival
        some = [one for one in some if search.log_posterior(one) > near]
        self._checked.update(some)
        return any([self.check_nested(some), self._check_exchanged(some), self._check_draws()])

    def check_nested(self, some: Sequence[Hypothesis]) -> bool:
        """Compare evidences with and without each effect to the effect's posterior at zero."""
        search, wanted = self._search, []
        count = search.checks["nested"]
        for one in some:
            for effect in search.added(one):
                starts = nested_starts(
                    search.density, search.candidates, one, effect, search.settings
                )
                if starts is not None:
                    count.made += 1
                    count.failed += len(starts) > 0
                    wanted += starts
        return self._optimize("nested", wanted)

    def _check_exchanged(self, some: Sequence[Hypothesis]) -> bool:
        """Optimise hypotheses without an extra relaxation mode from those that have it."""
        search = self._search
        starts = [
            start
            for one in some
            for start in exchanged_starts(
                search.density.space, search.modes[one][0], search.added(one)
            )
        ]
        search.checks["exchanged"].made += len(starts)
        return self._optimize("exchanged", starts)

    def _check_draws(self) -> bool:
        """Optimise the most probable hypotheses from relaxations that were not drawn before."""
        search = self._search
        some = [one for one in search.beam if one not in self._redrawn]
        self._redrawn.update(some)
        before = {one: search.log_posterior(one) for one in some}
        search.redraw(some, seed=_OTHER_SEED)
        search.checks["draws"].made += len(some)
        return self._count_higher("draws", before)

    def _optimize(self, check: str, starts: Sequence[Start]) -> bool:
        """Optimise from the starts of a check; return whether that led to a higher mode."""
        search = self._search
        before = {start.hypothesis: search.log_posterior(start.hypothesis) for start in starts}

        def look(start: Start) -> list[Candidate]:
            known = [one.mode for one in search.modes.get(start.hypothesis, [])]
            args = search.density, start.hypothesis, start.theta, search.lowest_loss
            return search.candidates_from(start.hypothesis, find_modes(*args, known=known))

        for start, new in zip(starts, in_parallel(look, starts), strict=True):
            search.keep(start.hypothesis, new)
        return self._count_higher(check, before)

    def _count_higher(self, check: str, before: dict[Hypothesis, float]) -> bool:
        """Count hypotheses that are more probable than before, and let them be expanded anew."""
        search = self._search
        least = search.breadth.higher
        higher = [one for one, log in before.items() if search.log_posterior(one) > log + least]
        search.checks[check].higher += len(higher)
        self._checked.difference_update(higher)
        search.reopen(higher)
        return bool(higher)


def nested_starts(
    density: Density,
    candidates: Mapping[Hypothesis, Candidate],
    hypothesis: Hypothesis,
    effect: str,
    settings: DiagnosisSettings,
) -> list[Start] | None:
    """Return starts where the evidences of two nested hypotheses do not agree.

    There are none where they agree. None is returned where the check cannot be made: the effect has
    no amplitude, the hypothesis without it was not evaluated, or zero amplitude is too far from the
    posterior.
    """
    less = hypothesis.less(effect)
    if less not in candidates:
        return None
    fuller, bare = candidates[hypothesis], candidates[less]
    expected = savage_dickey(fuller, effect, settings)
    if expected is None:
        return None
    if abs(fuller.log_evidence - bare.log_evidence - expected) < settings.breadth.apart:
        return []
    own, old = fuller.point, bare.point
    back = transferred(own.own, own.theta, old.own)
    forward = transferred(old.own, old.theta, own.own)
    forth = over_shapes(density.space, own.own, effect, forward, 1)[0]
    return [Start(less, back), Start(hypothesis, forth)]


def savage_dickey(fuller: Candidate, effect: str, settings: DiagnosisSettings) -> float | None:
    """Return the log Bayes factor of an effect from the densities of its amplitude at zero.

    The prior leaves out amplitudes that do not matter, as in the evidences (`noticeable`,
    with the settings' tolerance). It is None where zero is too far from the posterior,
    or where the effect has no amplitude.
    """
    own = fuller.point.own
    amplitude = amplitude_of(own, effect)
    if amplitude is None or not math.isfinite(fuller.log_evidence):
        return None
    k = amplitude.number
    mean, sd = float(fuller.evidence.mean[k]), math.sqrt(fuller.evidence.covariance[k, k])
    prior = next(leaf.prior.inner for leaf in own.leaves if leaf.theta.start == k)  # type: ignore[attr-defined]
    if abs(mean) > settings.breadth.reached * sd:
        return None
    within = norm.logsf(own.lowest[k], mean, sd) if own.lowest[k] == 0.0 else 0.0
    posterior = norm.logpdf(0.0, mean, sd) - within
    return float(prior.log_density(0.0) - posterior) + log_noticeable(
        prior, mean, sd, settings.tolerance
    )


def exchanged_starts(space: Space, fuller: Candidate, effects: Iterable[str]) -> Iterator[Start]:
    """Yield starts of the hypotheses without an effect that changes the relaxation.

    Each start leaves out another mode of the fuller hypothesis's spectrum. A long spectrum, whose
    modes are not independent, gives no starts.
    """
    hypothesis, point = fuller.hypothesis, fuller.point
    for effect in sorted(space.relaxing.intersection(effects)):
        less = hypothesis.less(effect)
        fractions, rates = space.spectra(hypothesis, point.constants[None])
        if rates.shape[1] > FEW + 1:
            continue
        theta = transferred(point.own, point.theta, space.parameters(less))
        for k in range(rates.shape[1]):
            rest = np.delete(fractions, k + 1, axis=1)
            rest /= rest.sum(axis=1, keepdims=True)
            goal = relaxation_of(rest, np.delete(rates, k, axis=1), space.curve_grids[1])[0]
            yield Start(less, with_curve(space, less, "relaxation", goal, theta))
