"""Fit described laws beside one hypothesis by least squares, and predict tests left out.

Beside a discrepancy smooth misfit would cost next to nothing; here it is what counts. The fits are
therefore those of least squares, under the priors: the noise is independent and as large as the
error of the hypothesis without a law. The sds of the constants are those of the jackknife over the
tests left out (Efron & Stein 1981, doi:10.1214/aos/1176345462), as least squares know nothing of
misfit, and at least those of least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.outcome import SearchOutcome
from qlvbayes.diagnosis.checks.samples import HeldOut, Samples, leave_out, predicted
from qlvbayes.diagnosis.description.grammar import Term, grammar
from qlvbayes.diagnosis.description.proposals import Proposal, proposals
from qlvbayes.diagnosis.description.source import ADDED_BY, References, load, name_of, source_of
from qlvbayes.effects.effect import AbstractEffect, Protocol
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import in_natural_amplitude
from qlvbayes.inference.modes import Mode, find_mode
from qlvbayes.inference.starts import transferred
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.motion.record import Record


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
    def residuals(self) -> list[Array]:
        """Measured minus predicted force (n,) of each test (N)."""
        return self.samples.residuals(self.density, self.mode)

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


class LawFits:
    """Fits of laws beside one hypothesis."""

    def __init__(self, outcome: SearchOutcome, base: Candidate, protocol: Protocol) -> None:
        self.outcome, self.experiment = outcome, outcome.experiment
        self.references = References.from_scales(self.experiment.scales)
        self.settings = outcome.search.settings.description
        bonded = outcome.search.density.space.bonded
        # a bonded specimen has no contact that a shift could move, and the rig is not off it
        lasting = [t for t in grammar() if t.enters in ("force", "factor") or t.family == "clock"]
        kinds = {term: load(self.text([term])) for term in (lasting if bonded else grammar())}
        self.kinds = {t: k for t, k in kinds.items() if k.blind(protocol) is None}
        # independent noise as large as the error of the base, and the errors of contacts
        samples, density = outcome.samples, outcome.search.density
        contacts = samples.contacts.changes(density.space.record.blocks)
        error = samples.error(outcome.residuals(base))
        self.density = density.with_independent_noise(error, contacts)
        found = self._plain(base)
        if found is None:
            raise NoFiniteForceError
        self.base = found

    def _plain(self, candidate: Candidate) -> Fitted | None:
        """Return a hypothesis without a law; None where no finite force is found."""
        mode = find_mode(self.density, candidate.hypothesis, candidate.point.theta)
        return Fitted((), "", self.density, self.outcome.samples, mode) if mode else None

    def text(self, terms: Sequence[Term]) -> str:
        """Return the text of the file of a law."""
        about = (
            f"This law describes the tests of pad {self.experiment.pad}; it names no cause. Add it "
            f"with\n\n    {ADDED_BY}"
        )
        return source_of(terms, self.references, self.experiment.units, about)

    def extended(self, kinds: Sequence[type[AbstractEffect]]) -> Density:
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
        density = self.extended([*self.kinds.values(), *of_law])
        return proposals(density, law.mode, names, self.settings.shapes)

    def fit(self, proposal: Proposal, law: Fitted) -> Fitted | None:
        """Return a law with one term more, all constants fitted; None without a finite force."""
        terms = (*law.terms, proposal.term)
        text = self.text(terms)
        kind = load(text)
        density = self.extended([kind])
        hypothesis = self.base.hypothesis.plus(kind.name)
        start = _start(density.space.parameters(hypothesis), kind.name, proposal, law)
        mode = find_mode(density, hypothesis, start)
        samples = replace(self.outcome.samples, space=density.space)
        return Fitted(terms, text, density, samples, mode) if mode else None


def _start(parameters: Parameters, name: str, proposal: Proposal, law: Fitted) -> Array:
    """Return theta (F,) with the term as proposed, beside the law as it was fitted."""
    known, leaves = law.mode.point, parameters.by_name
    theta = transferred(known.own, known.theta, parameters)
    for key, leaf in known.own.by_name.items():
        if law.terms and key.startswith(f"{law.name}."):
            own = leaves[f"{name}.{key.partition('.')[2]}1"]
            theta[list(own.theta)] = known.theta[list(leaf.theta)]
    last = "2" if law.terms else ""
    for one, value in zip(proposal.term.shapes, proposal.shape, strict=True):
        theta[leaves[f"{name}.{one.name}{last}"].theta.start] = value
    theta[leaves[f"{name}.k{last}"].theta.start] = proposal.amplitude
    return parameters.within(theta)
