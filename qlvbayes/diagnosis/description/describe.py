r"""The smallest law that removes what no listed effect explains, as an effect to be added.

Terms that would explain most (`proposals`) are fitted with all constants (`fits`) and judged on
tests left out. With :math:`E_k` the root mean square error of a test by a fit to all others, with
the noise floor added in squares, before and after,

.. math:: g_k = \ln \frac{E_k^{before}}{E_k^{after}}, \quad
          \text{sds} = \frac{\bar g}{s_g/\sqrt n}

over the n tests left out (the phases, where there is only one test). A term is kept if sds is
`DescriptionSettings.sds` or more, and if the error over all of them falls by
`DescriptionSettings.price` for each of the term's constants. A second term has to do the same again
beside the first. What is kept describes the tests; it names no cause.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate, candidate_at
from qlvbayes.diagnosis.checks.outcome import SearchOutcome, estimates_at
from qlvbayes.diagnosis.checks.samples import cell_errors, rmse
from qlvbayes.diagnosis.checks.strengths import strengths
from qlvbayes.diagnosis.description.fits import Fitted, LawFits, LeftOut
from qlvbayes.diagnosis.description.proposals import Proposal
from qlvbayes.diagnosis.description.source import formula_of
from qlvbayes.diagnosis.result import Closest, Description, LawPair, TermFamily
from qlvbayes.diagnosis.search import Report
from qlvbayes.effects.effect import Protocol
from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.modes import Mode
from qlvbayes.inference.starts import without
from qlvbayes.io.arrays import Array
from qlvbayes.motion.record import Record

_LEAST_PARTS = 3  # tests or phases left out, from which their scatter is known
_CLOSEST = 2  # listed effects that are compared with a law


@dataclass(frozen=True, eq=False)
class FittedHypothesis:
    """A hypothesis at fitted constants (P,), which predicts other tests."""

    space: Space
    hypothesis: Hypothesis
    constants: Array

    def forces(self, record: Record) -> Array:
        """Return block means (T, B) of the force (N) of the tests of a record."""
        return self.space.forces(self.hypothesis, self.constants[None], record)[0]


@dataclass(frozen=True, eq=False)
class Described:
    """The law that was kept, if any.

    record: What ``diagnosis.json`` says of it; text: Its file; families: What terms of each kind
    could do; before, after: The hypothesis without it and with it.
    """

    record: Description | None = None
    text: str = ""
    families: tuple[TermFamily, ...] = ()
    before: FittedHypothesis | None = None
    after: FittedHypothesis | None = None


NOTHING = Described()


def describe(
    outcome: SearchOutcome, named: frozenset[str], protocol: Protocol, report: Report
) -> Described:
    """Return the smallest law beside the named effects, and what each family of terms could do.

    Parameters
    ----------
    outcome, named, protocol, report
        The posterior over hypotheses; the effects, in their forms, that the law comes beside; the
        protocol of the tests; is called with a line of text before each step.
    """
    base = _base(outcome, named)
    report("a law for what is left")
    fits = LawFits(outcome, base, protocol)
    before = fits.left_out(fits.base)
    first, listed = fits.proposed(), fits.listed()
    families = tuple(_families(fits, first, listed))
    if len(before.residuals) < _LEAST_PARTS:
        return Described(families=families)
    kept, left = _smallest(fits, before, first, report)
    plain = _fitted(fits.density.space, fits.base.point)
    if kept is None:
        return Described(families=families, before=plain)
    return Described(
        _record(fits, base, before, kept, left, listed),
        kept.text,
        families,
        plain,
        _fitted(kept.density.space, kept.mode.point),
    )


def _fitted(space: Space, point: Point) -> FittedHypothesis:
    return FittedHypothesis(space, point.own.hypothesis, point.constants)


def _base(outcome: SearchOutcome, named: frozenset[str]) -> Candidate:
    """Return the most probable hypothesis with just the named effects, of a named elastic law."""
    search = outcome.search
    same = [one for one in outcome.candidates if one.hypothesis.effects == named]
    known = [one for one in same if one.hypothesis.elastic in search.nameable_laws]
    some = known or same or [search.modes[search.baseline][0]]
    return max(some, key=lambda one: search.log_posterior(one.hypothesis))


def _smallest(
    fits: LawFits, before: LeftOut, first: Sequence[Proposal], report: Report
) -> tuple[Fitted | None, LeftOut]:
    """Return the law of fewest terms that another term does not better, and its tests left out."""
    settings, judged = fits.settings, dict[int, LeftOut]()

    def best(proposals: Sequence[Proposal], law: Fitted | None, known: LeftOut) -> Fitted | None:
        some = [one for p in proposals[: settings.fitted] if (one := fits.fit(p, law))]
        some.sort(key=lambda one: one.mode.loss)
        kept = []
        for one in some[: settings.judged]:
            judged[id(one)] = fits.left_out(one.mode, one)
            constants = one.count - (law.count if law else 0)
            if _is_better(fits, known, judged[id(one)], constants):
                kept.append(one)
        return min(kept, key=lambda one: rmse(judged[id(one)].residuals), default=None)

    report("laws of one term")
    law = best(first, None, before)
    if law is None:
        return None, before
    report("laws of two terms")
    second = best(fits.proposed(law), law, judged[id(law)])
    kept = second or law
    return kept, judged[id(kept)]


def _is_better(fits: LawFits, before: LeftOut, after: LeftOut, constants: int) -> bool:
    """Return whether tests left out are predicted better, at the price of the constants."""
    falls = 1.0 - rmse(after.residuals) / rmse(before.residuals)
    enough = falls >= constants * fits.settings.price
    return enough and sds_of(before, after, fits.experiment.floor.total) >= fits.settings.sds


def sds_of(before: LeftOut, after: LeftOut, noise: float) -> float:
    """Return the mean relative fall of the error of the parts left out, in standard errors."""
    first, last = (
        np.array([math.hypot(rmse([one]), noise) for one in own.residuals])
        for own in (before, after)
    )
    gains = np.log(first / last)
    error = float(gains.std(ddof=1)) / math.sqrt(gains.size)
    return float(gains.mean()) / error if error > 0.0 else 0.0


def _families(
    fits: LawFits, proposed: Sequence[Proposal], listed: Sequence[tuple[str, Mode]]
) -> Iterator[TermFamily]:
    """Yield the share of the fit's error that the best term of each family could remove.

    That of terms is to first order; the listed effect that fits best is one of them.
    """
    residual = fits.base.point.residual
    whole = float(residual @ residual)
    shares = [
        (f"the listed {family}", _share(float(np.sum(mode.point.residual**2)), whole))
        for family, mode in listed[:1]
    ]
    for family in dict.fromkeys(one.column.term.family for one in proposed):
        squares = max(one.squares for one in proposed if one.column.term.family == family)
        shares.append((family, _share(whole - squares, whole)))
    for family, share in sorted(shares, key=lambda one: -one[1]):
        yield TermFamily(family, share)


def _share(left: float, whole: float) -> float:
    """Return the share of an error that is removed, from the sums of squares left and before."""
    return max(1.0 - math.sqrt(max(left / whole, 0.0)), 0.0)


def _record(
    fits: LawFits,
    base: Candidate,
    before: LeftOut,
    law: Fitted,
    after: LeftOut,
    listed: Sequence[tuple[str, Mode]],
) -> Description:
    """Return the record of a law that was kept."""
    outcome, samples, point = fits.outcome, law.samples, law.mode.point
    hypothesis = point.own.hypothesis
    residuals = samples.residuals(hypothesis, point.constants)
    plain = outcome.samples.residuals(base.hypothesis, fits.base.point.constants)
    settings = outcome.search.settings
    candidate = candidate_at(law.density, hypothesis, law.mode, settings.tolerance)
    every = estimates_at(fits.experiment.units, point, law.sds(after))
    prefix = f"{law.name}."
    own = {key.removeprefix(prefix): x for key, x in every.items() if key.startswith(prefix)}
    return Description(
        effect=law.name,
        formula=formula_of(law.terms, fits.references, fits.experiment.units),
        base=LawPair(*base.hypothesis.base),
        effects=tuple(outcome.search.added(base.hypothesis)),
        parameters=own,
        rmse_before=samples.error(plain),
        rmse_after=samples.error(residuals),
        heldout_before=rmse(before.residuals),
        heldout_after=rmse(after.residuals),
        sds=sds_of(before, after, fits.experiment.floor.total),
        cells=tuple(cell_errors(samples, residuals)),
        strengths=strengths(law.density, samples, candidate, law.name, settings.imitation),
        closest=tuple(_closest(fits, law, listed)),
    )


def _closest(fits: LawFits, law: Fitted, listed: Sequence[tuple[str, Mode]]) -> Iterator[Closest]:
    """Yield the listed effect that fits best, and those whose forces are nearest to the law's."""
    own = _force(fits, law.density.space, law.mode.point, law.name)
    found = []
    for family, mode in listed:
        (form,) = mode.point.own.hypothesis.effects - fits.hypothesis.effects
        other = _force(fits, fits.density.space, mode.point, form)
        size = float(np.linalg.norm(own) * np.linalg.norm(other))
        if size > 0.0 and math.isfinite(size):
            found.append((float(own @ other) / size, family, other, mode))
    nearest = sorted(found, key=lambda one: -one[0])[:_CLOSEST]
    real = fits.density.space.real
    tests = np.broadcast_to(np.arange(len(real))[:, None], real.shape)[real]
    for cosine, family, other, mode in {one[1]: one for one in (*found[:1], *nearest)}.values():
        scaled = other * float(own @ other) / float(other @ other)
        apart = np.bincount(tests, (own - scaled) ** 2)
        name = fits.outcome.samples.trials[int(np.argmax(apart))].name
        yield Closest(family, cosine, name, rmse(fits.left_out(mode).residuals))


def _force(fits: LawFits, space: Space, point: Point, effect: str) -> Array:
    """Return the force (n,) in N of one effect, less what the base's constants can follow."""
    real = fits.density.space.real
    rest = space.forces(*without(space, point, effect))[0]
    force = (point.predicted - rest)[real]
    taken, _ = np.linalg.qr(fits.base.point.responses[:, real].T)
    return np.asarray(force - taken @ (taken.T @ force))
