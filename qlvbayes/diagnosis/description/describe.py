r"""The smallest law that removes what no listed effect explains, as an effect to be added.

Terms that would explain most (`proposals`) are fitted with all constants (`LawFits`) and judged on
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
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate, candidate_at
from qlvbayes.diagnosis.checks.outcome import SearchOutcome, estimates_at, of_effect
from qlvbayes.diagnosis.checks.samples import (
    HeldOut,
    Samples,
    cell_errors,
    error,
    leave_out,
    predicted,
)
from qlvbayes.diagnosis.checks.support import strengths
from qlvbayes.diagnosis.description.grammar import Proposal, Term, grammar, proposals
from qlvbayes.diagnosis.description.source import (
    ADDED_BY,
    References,
    formula_of,
    load,
    name_of,
    source_of,
)
from qlvbayes.diagnosis.result import Closest, Description, LawPair, TermFamily
from qlvbayes.diagnosis.search import Report
from qlvbayes.effects.effect import AbstractEffect, Protocol
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import in_natural_amplitude
from qlvbayes.inference.modes import Mode, find_mode
from qlvbayes.inference.starts import transferred, without
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.motion.record import Record

_LEAST_PARTS = 3  # tests or phases left out, from which their scatter is known
_CLOSEST = 2  # listed effects that are compared with a law


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis of listed effects with a law of no, one or two terms, at its mode."""

    terms: tuple[Term, ...]
    text: str  # of the law's file
    density: Density
    samples: Samples
    mode: Mode

    @property
    def name(self) -> str:
        """Name of the law as an effect."""
        return name_of(self.terms)

    @property
    def count(self) -> int:
        """Number of the law's constants."""
        return sum(1 + len(term.shapes) for term in self.terms)

    @property
    def hypothesis(self) -> Hypothesis:
        """The hypothesis, with the law as one of its effects."""
        return self.mode.point.own.hypothesis

    @property
    def squares(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(np.sum(self.mode.point.residual**2))

    @cached_property
    def left_out(self) -> list[HeldOut]:
        """The prediction of each part by a fit to all others."""
        return predicted(self.samples, leave_out(self.density, self.samples), self.mode)

    @property
    def sds(self) -> Array:
        """The sd (P,) of every constant."""
        own = np.stack([part.constants for part in self.left_out])
        few, slopes = len(own), self.mode.point.slopes
        jackknife = (few - 1) / few * np.sum((own - own.mean(axis=0)) ** 2, axis=0)
        spread = slopes @ np.linalg.pinv(self.mode.curvature) @ slopes.T
        return np.sqrt(np.maximum(jackknife, np.diag(spread)))

    def forces(self, record: Record) -> Array:
        """Return block means (T, B) of the force (N) of the tests of a record."""
        constants = self.mode.point.constants
        return self.density.space.forces(self.hypothesis, constants[None], record)[0]

    def force_of(self, effect: str, base: Mode) -> Array:
        """Return the force (n,) in N of one effect, less what a base's constants can follow."""
        space, point = self.density.space, self.mode.point
        rest = space.forces(*without(space, point, effect))[0]
        force = (point.predicted - rest)[space.real]
        taken, _ = np.linalg.qr(base.point.responses[:, space.real].T)
        return np.asarray(force - taken @ (taken.T @ force))


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
    families = tuple(_families(fits.base, first, listed))
    if len(fits.base.left_out) < _LEAST_PARTS:
        return Described(families=families)
    report("laws of one term")
    law = fits.best(fits.base, first)
    if law is None:
        return Described(families=families, before=fits.base)
    report("laws of two terms")
    law = fits.best(law, fits.proposed(law)) or law
    return Described(_record(fits, law, listed), families, fits.base, law)


def _base(outcome: SearchOutcome, named: frozenset[str]) -> Candidate:
    """Return the most probable hypothesis with just the named effects, of a named elastic law."""
    search = outcome.search
    same = [one for one in outcome.candidates if one.hypothesis.effects == named]
    known = [one for one in same if one.hypothesis.elastic in search.nameable_laws]
    some = known or same or [outcome.baseline]
    return max(some, key=lambda one: search.log_posterior(one.hypothesis))


class LawFits:
    """Fits of laws beside one hypothesis by least squares, which predict tests left out.

    Beside a discrepancy smooth misfit would cost next to nothing; here it is what counts. The fits
    are therefore those of least squares, under the priors: the noise is independent and as large as
    the error of the hypothesis without a law. The sds of the constants are those of the jackknife
    over the tests left out (Efron & Stein 1981, doi:10.1214/aos/1176345462), as least squares know
    nothing of misfit, and at least those of least squares.
    """

    def __init__(self, outcome: SearchOutcome, base: Candidate, protocol: Protocol) -> None:
        self.outcome, self.experiment = outcome, outcome.experiment
        self.references = References.from_scales(self.experiment.scales)
        self.settings = outcome.search.settings.description
        samples, density = outcome.samples, outcome.search.density
        terms: Sequence[Term] = grammar()
        if density.space.bonded:  # no contact that a shift could move, and the rig is not off it
            terms = [t for t in terms if t.enters in ("force", "factor") or t.family == "clock"]
        kinds = {term: load(self._text([term])) for term in terms}
        self.kinds = {t: k for t, k in kinds.items() if k.blind(protocol) is None}
        # independent noise as large as the error of the base, and the errors of contacts
        contacts = samples.contacts.changes(density.space.record.blocks)
        self.density = density.with_independent_noise(
            samples.error(outcome.residuals(base)), contacts
        )
        found = self._plain(base)
        if found is None:
            raise NoFiniteForceError
        self.base = found

    def _plain(self, candidate: Candidate) -> Fitted | None:
        """Return a hypothesis without a law; None where no finite force is found."""
        mode = find_mode(self.density, candidate.hypothesis, candidate.point.theta)
        return Fitted((), "", self.density, self.outcome.samples, mode) if mode else None

    def _text(self, terms: Sequence[Term]) -> str:
        """Return the text of the file of a law."""
        about = (
            f"This law describes the tests of pad {self.experiment.pad}; it names no cause. Add it "
            f"with\n\n    {ADDED_BY}"
        )
        return source_of(terms, self.references, self.experiment.units, about)

    def _extended(self, kinds: Sequence[type[AbstractEffect]]) -> Density:
        """Return the density in a space that also holds some described effects."""
        effects = (kind.default(self.experiment.scales) for kind in kinds)
        own = {one.name: in_natural_amplitude(one) for one in effects}
        space = self.density.space
        return self.density.with_space(space.with_effects({**space.effects, **own}))

    def listed(self) -> list[tuple[str, Fitted]]:
        """Return listed effects beside the hypothesis, each by its family, the best fits first."""
        outcome, families = self.outcome, self.outcome.search.families
        base, some = self.base.hypothesis, []
        for one in outcome.candidates:
            added = one.hypothesis.effects - base.effects
            if len(added) == 1 and base.plus(*added) == one.hypothesis:
                some.append((families.family_of[next(iter(added))], one))
        some = [(family, one) for family, one in some if family in families.nameable]
        some.sort(key=lambda pair: outcome.samples.error(outcome.residuals(pair[1])))
        found: dict[str, Fitted] = {}
        for family, one in some:
            if family not in found and len(found) < self.settings.judged:
                fitted = self._plain(one)
                found |= {family: fitted} if fitted is not None else {}
        return sorted(found.items(), key=lambda pair: pair[1].mode.loss)

    def proposed(self, law: Fitted) -> list[Proposal]:
        """Return terms to add to a law, or to the base."""
        of_law = [load(law.text)] if law.terms else []
        names = {
            term: kind.name
            for term, kind in self.kinds.items()
            if term not in law.terms and all(term.joins(one) for one in law.terms)
        }
        density = self._extended([*self.kinds.values(), *of_law])
        return proposals(density, law.mode, names, self.settings.shapes)

    def best(self, law: Fitted, proposed: Sequence[Proposal]) -> Fitted | None:
        """Return the law with one term more that predicts tests left out best, if it is better."""
        some = [one for p in proposed[: self.settings.fitted] if (one := self._fit(p, law))]
        some.sort(key=lambda one: one.mode.loss)
        kept = [one for one in some[: self.settings.judged] if self._is_better(law, one)]
        return min(kept, key=lambda one: error(one.left_out), default=None)

    def _fit(self, proposal: Proposal, law: Fitted) -> Fitted | None:
        """Return a law with one term more, all constants fitted; None without a finite force."""
        terms = (*law.terms, proposal.term)
        text = self._text(terms)
        kind = load(text)
        density = self._extended([kind])
        parameters = density.space.parameters(self.base.hypothesis.plus(kind.name))
        # the term as proposed, beside the law as it was fitted
        known, leaves = law.mode.point, parameters.by_name
        theta = transferred(known.own, known.theta, parameters)
        for key, leaf in known.own.by_name.items():
            if law.terms and key.startswith(f"{law.name}."):
                own = leaves[f"{kind.name}.{key.partition('.')[2]}1"]
                theta[list(own.theta)] = known.theta[list(leaf.theta)]
        last = "2" if law.terms else ""
        for one, value in zip(proposal.term.shapes, proposal.shape, strict=True):
            theta[leaves[f"{kind.name}.{one.name}{last}"].theta.start] = value
        theta[leaves[f"{kind.name}.k{last}"].theta.start] = proposal.amplitude
        mode = find_mode(density, parameters.hypothesis, parameters.within(theta))
        samples = replace(self.outcome.samples, space=density.space)
        return Fitted(terms, text, density, samples, mode) if mode else None

    def _is_better(self, before: Fitted, after: Fitted) -> bool:
        """Return whether tests left out are predicted better, at the price of the constants."""
        falls = 1.0 - error(after.left_out) / error(before.left_out)
        enough = falls >= (after.count - before.count) * self.settings.price
        return enough and self.sds_of(before, after) >= self.settings.sds

    def sds_of(self, before: Fitted, after: Fitted) -> float:
        """Return the mean relative fall of the error of the parts left out, in standard errors."""
        noise = self.experiment.floor.total
        first, last = (
            np.array([math.hypot(error([one]), noise) for one in own.left_out])
            for own in (before, after)
        )
        gains = np.log(first / last)
        scatter = float(gains.std(ddof=1)) / math.sqrt(gains.size)
        return float(gains.mean()) / scatter if scatter > 0.0 else 0.0


def _families(
    base: Fitted, proposed: Sequence[Proposal], listed: Sequence[tuple[str, Fitted]]
) -> Iterator[TermFamily]:
    """Yield the share of the fit's error that the best term of each family could remove.

    That of terms is to first order; the listed effect that fits best is one of them.
    """
    left = {f"the listed {family}": one.squares for family, one in listed[:1]}
    for proposal in sorted(proposed, key=lambda one: one.squares):
        left[proposal.term.family] = base.squares - proposal.squares
    shares = {name: 1.0 - math.sqrt(max(x / base.squares, 0.0)) for name, x in left.items()}
    for family, share in sorted(shares.items(), key=lambda one: -max(one[1], 0.0)):
        yield TermFamily(family, max(share, 0.0))


def _record(fits: LawFits, law: Fitted, listed: Sequence[tuple[str, Fitted]]) -> Description:
    """Return the record of a law that was kept."""
    outcome, base, samples, units = fits.outcome, fits.base, law.samples, fits.experiment.units
    settings = outcome.search.settings
    candidate = candidate_at(law.density, law.hypothesis, law.mode, settings.tolerance)
    before, residuals = (one.samples.residuals(one.density, one.mode) for one in (base, law))
    return Description(
        effect=law.name,
        formula=formula_of(law.terms, fits.references, units),
        base=LawPair(*base.hypothesis.base),
        effects=tuple(outcome.search.added(base.hypothesis)),
        parameters=of_effect(estimates_at(units, law.mode.point, law.sds), f"{law.name}."),
        rmse_before=samples.error(before),
        rmse_after=samples.error(residuals),
        heldout_before=error(base.left_out),
        heldout_after=error(law.left_out),
        sds=fits.sds_of(base, law),
        cells=tuple(cell_errors(samples, residuals)),
        strengths=strengths(law.density, samples, candidate, law.name, settings.imitation),
        closest=tuple(_closest(fits, law, listed)),
    )


def _closest(fits: LawFits, law: Fitted, listed: Sequence[tuple[str, Fitted]]) -> Iterator[Closest]:
    """Yield the listed effect that fits best, and those whose forces are nearest to the law's."""
    base, own = fits.base, law.force_of(law.name, fits.base.mode)
    found = []
    for family, one in listed:
        (form,) = one.hypothesis.effects - base.hypothesis.effects
        other = one.force_of(form, base.mode)
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
