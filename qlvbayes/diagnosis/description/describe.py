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
from qlvbayes.diagnosis.checks.samples import cell_errors, error
from qlvbayes.diagnosis.checks.support import strengths
from qlvbayes.diagnosis.description.fits import Fitted, LawFits
from qlvbayes.diagnosis.description.proposals import Proposal
from qlvbayes.diagnosis.description.source import formula_of
from qlvbayes.diagnosis.result import Closest, Description, LawPair, TermFamily
from qlvbayes.diagnosis.search import Report
from qlvbayes.effects.effect import Protocol
from qlvbayes.inference.starts import without
from qlvbayes.io.arrays import Array

_LEAST_PARTS = 3  # tests or phases left out, from which their scatter is known
_CLOSEST = 2  # listed effects that are compared with a law


@dataclass(frozen=True, eq=False)
class Described:
    """The law that was kept, if any."""

    record: Description | None = None  # what ``diagnosis.json`` says of it
    families: tuple[TermFamily, ...] = ()  # what terms of each kind could do
    # before, after: the hypothesis without it and with it
    before: Fitted | None = None
    after: Fitted | None = None

    @property
    def text(self) -> str:
        """Text of the law's file; empty without a law."""
        return self.after.text if self.after else ""


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
    report("a law for what is left")
    fits = LawFits(outcome, _base(outcome, named), protocol)
    first, listed = fits.proposed(fits.base), fits.listed()
    families = tuple(_families(fits, first, listed))
    if len(fits.base.left_out) < _LEAST_PARTS:
        return Described(families=families)
    report("laws of one term")
    law = _best(fits, fits.base, first)
    if law is None:
        return Described(families=families, before=fits.base)
    report("laws of two terms")
    law = _best(fits, law, fits.proposed(law)) or law
    return Described(_record(fits, law, listed), families, fits.base, law)


def _base(outcome: SearchOutcome, named: frozenset[str]) -> Candidate:
    """Return the most probable hypothesis with just the named effects, of a named elastic law."""
    search = outcome.search
    same = [one for one in outcome.candidates if one.hypothesis.effects == named]
    known = [one for one in same if one.hypothesis.elastic in search.nameable_laws]
    some = known or same or [search.modes[search.baseline][0]]
    return max(some, key=lambda one: search.log_posterior(one.hypothesis))


def _best(fits: LawFits, law: Fitted, proposed: Sequence[Proposal]) -> Fitted | None:
    """Return the law with one term more that predicts tests left out best, if it is better."""
    settings = fits.settings
    some = [one for p in proposed[: settings.fitted] if (one := fits.fit(p, law))]
    some.sort(key=lambda one: one.mode.loss)
    kept = [one for one in some[: settings.judged] if _is_better(fits, law, one)]
    return min(kept, key=lambda one: error(one.left_out), default=None)


def _is_better(fits: LawFits, before: Fitted, after: Fitted) -> bool:
    """Return whether tests left out are predicted better, at the price of the constants."""
    falls = 1.0 - error(after.left_out) / error(before.left_out)
    enough = falls >= (after.count - before.count) * fits.settings.price
    return enough and sds_of(before, after, fits.experiment.floor.total) >= fits.settings.sds


def sds_of(before: Fitted, after: Fitted, noise: float) -> float:
    """Return the mean relative fall of the error of the parts left out, in standard errors."""
    first, last = (
        np.array([math.hypot(error([one]), noise) for one in own.left_out])
        for own in (before, after)
    )
    gains = np.log(first / last)
    scatter = float(gains.std(ddof=1)) / math.sqrt(gains.size)
    return float(gains.mean()) / scatter if scatter > 0.0 else 0.0


def _families(
    fits: LawFits, proposed: Sequence[Proposal], listed: Sequence[tuple[str, Fitted]]
) -> Iterator[TermFamily]:
    """Yield the share of the fit's error that the best term of each family could remove.

    That of terms is to first order; the listed effect that fits best is one of them.
    """
    whole = float(np.sum(fits.base.mode.point.residual**2))
    left = {
        f"the listed {family}": float(np.sum(one.mode.point.residual**2))
        for family, one in listed[:1]
    }
    for one in sorted(proposed, key=lambda one: one.squares):
        left[one.term.family] = whole - one.squares
    shares = {name: max(1.0 - math.sqrt(max(x / whole, 0.0)), 0.0) for name, x in left.items()}
    for family, share in sorted(shares.items(), key=lambda one: -one[1]):
        yield TermFamily(family, share)


def _record(fits: LawFits, law: Fitted, listed: Sequence[tuple[str, Fitted]]) -> Description:
    """Return the record of a law that was kept."""
    outcome, base, samples, residuals = fits.outcome, fits.base, law.samples, law.residuals
    settings = outcome.search.settings
    candidate = candidate_at(law.density, law.hypothesis, law.mode, settings.tolerance)
    every = estimates_at(fits.experiment.units, law.mode.point, law.sds)
    prefix = f"{law.name}."
    own = {key.removeprefix(prefix): x for key, x in every.items() if key.startswith(prefix)}
    return Description(
        effect=law.name,
        formula=formula_of(law.terms, fits.references, fits.experiment.units),
        base=LawPair(*base.hypothesis.base),
        effects=tuple(outcome.search.added(base.hypothesis)),
        parameters=own,
        rmse_before=samples.error(base.residuals),
        rmse_after=samples.error(residuals),
        heldout_before=error(base.left_out),
        heldout_after=error(law.left_out),
        sds=sds_of(base, law, fits.experiment.floor.total),
        cells=tuple(cell_errors(samples, residuals)),
        strengths=strengths(law.density, samples, candidate, law.name, settings.imitation),
        closest=tuple(_closest(fits, law, listed)),
    )


def _closest(fits: LawFits, law: Fitted, listed: Sequence[tuple[str, Fitted]]) -> Iterator[Closest]:
    """Yield the listed effect that fits best, and those whose forces are nearest to the law's."""
    own = _force(fits.base, law, law.name)
    found = []
    for family, one in listed:
        (form,) = one.hypothesis.effects - fits.base.hypothesis.effects
        other = _force(fits.base, one, form)
        size = float(np.linalg.norm(own) * np.linalg.norm(other))
        if size > 0.0 and math.isfinite(size):
            found.append((float(own @ other) / size, family, other, one))
    nearest = sorted(found, key=lambda one: -one[0])[:_CLOSEST]
    real = fits.density.space.real
    tests = np.broadcast_to(np.arange(len(real))[:, None], real.shape)[real]
    for cosine, family, other, one in {one[1]: one for one in (*found[:1], *nearest)}.values():
        scaled = other * float(own @ other) / float(other @ other)
        apart = np.bincount(tests, (own - scaled) ** 2)
        name = fits.outcome.samples.trials[int(np.argmax(apart))].name
        yield Closest(family, cosine, name, error(one.left_out))


def _force(base: Fitted, fitted: Fitted, effect: str) -> Array:
    """Return the force (n,) in N of one effect, less what the base's constants can follow."""
    space, point = fitted.density.space, fitted.mode.point
    rest = space.forces(*without(space, point, effect))[0]
    force = (point.predicted - rest)[space.real]
    taken, _ = np.linalg.qr(base.mode.point.responses[:, space.real].T)
    return np.asarray(force - taken @ (taken.T @ force))
