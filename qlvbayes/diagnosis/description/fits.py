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

import numpy as np

from qlvbayes.diagnosis.candidate import Candidate
from qlvbayes.diagnosis.checks.heldout import leave_out
from qlvbayes.diagnosis.checks.outcome import SearchOutcome
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.description.grammar import Term, grammar
from qlvbayes.diagnosis.description.proposals import Proposal, columns_of, proposals
from qlvbayes.diagnosis.description.source import ADDED_BY, References, load, source_of
from qlvbayes.effects.effect import AbstractEffect, Protocol
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import in_natural_amplitude
from qlvbayes.inference.modes import Mode, find_mode
from qlvbayes.inference.starts import transferred
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.priors.natural import in_quadratic_coordinates


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Residuals (N) of each part left out, and the constants (P,) by the fit to all others."""

    residuals: list[Array]
    constants: list[Array]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A law that was fitted: its terms, effect and file, and the mode."""

    terms: tuple[Term, ...]
    effect: type[AbstractEffect]
    text: str
    density: Density
    samples: Samples
    mode: Mode

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def count(self) -> int:
        """Number of the law's constants."""
        return len(self.effect.units)

    def sds(self, left_out: LeftOut) -> Array:
        """Return the sd (P,) of every constant."""
        point, own = self.mode.point, np.stack(left_out.constants)
        few = len(own)
        jackknife = (few - 1) / few * np.sum((own - own.mean(axis=0)) ** 2, axis=0)
        spread = point.slopes @ np.linalg.pinv(self.mode.curvature) @ point.slopes.T
        return np.sqrt(np.maximum(jackknife, np.diag(spread)))


class LawFits:
    """Fits and judges laws beside one hypothesis."""

    def __init__(self, outcome: SearchOutcome, base: Candidate, protocol: Protocol) -> None:
        self.outcome, self.experiment = outcome, outcome.experiment
        self.references = References.from_scales(self.experiment.scales)
        bonded = outcome.search.density.space.bonded
        # a bonded specimen has no contact that a shift could move, and the rig is not off it
        lasting = [t for t in grammar() if t.enters in ("force", "factor") or t.family == "clock"]
        terms = lasting if bonded else grammar()
        kinds = {term: load(self.text([term])) for term in terms}
        self.kinds = {t: k for t, k in kinds.items() if k.blind(protocol) is None}
        self.hypothesis = base.hypothesis
        # independent noise as large as the error of the base
        error = outcome.samples.error(outcome.residuals(base))
        self.density = outcome.search.density.with_independent_noise(error)
        found = find_mode(self.density, base.hypothesis, base.point.theta)
        if found is None:
            raise NoFiniteForceError
        self.base: Mode = found
        self.settings = outcome.search.settings.description

    def left_out(self, mode: Mode, law: Fitted | None = None) -> LeftOut:
        """Return what fits to all but one part predict of that part, from a mode on all parts.

        The mode is that of a law, or of a hypothesis of listed effects.
        """
        density = law.density if law else self.density
        samples = law.samples if law else self.outcome.samples
        residuals, fitted = [], []
        hypothesis = mode.point.own.hypothesis
        for part in leave_out(density, samples):
            found = find_mode(part.density, hypothesis, mode.point.theta)
            constants = (found or mode).point.constants
            force = samples.predict(hypothesis, constants[None])[part.test][0][part.rows]
            residuals.append(samples.observed[part.test][part.rows] - force)
            fitted.append(constants)
        return LeftOut(residuals, fitted)

    def text(self, terms: Sequence[Term]) -> str:
        """Return the text of the file of a law."""
        about = (
            f"This law describes the tests of pad {self.experiment.pad}; it names no cause. Add it "
            f"with\n\n    {ADDED_BY}"
        )
        return source_of(terms, self.references, self.experiment.units, about)

    def extended(self, kinds: Sequence[type[AbstractEffect]]) -> Density:
        """Return the density in a space that also holds some described effects."""
        own = {
            kind.name: in_quadratic_coordinates(
                in_natural_amplitude(kind.default(self.experiment.scales))
            )
            for kind in kinds
        }
        space = self.density.space
        return self.density.with_space(space.with_effects({**space.effects, **own}))

    def listed(self) -> list[tuple[str, Mode]]:
        """Return listed effects beside the hypothesis, each by its family, the best fits first."""
        outcome, families = self.outcome, self.outcome.search.families
        some = []
        for one in outcome.candidates:
            added = one.hypothesis.effects - self.hypothesis.effects
            if len(added) == 1 and self.hypothesis.plus(*added) == one.hypothesis:
                some.append((families.family_of[next(iter(added))], one))
        some = [(family, one) for family, one in some if family in families.nameable]
        some.sort(key=lambda pair: outcome.samples.error(outcome.residuals(pair[1])))
        found: dict[str, Mode] = {}
        for family, one in some:
            if family not in found and len(found) < self.settings.judged:
                mode = find_mode(self.density, one.hypothesis, one.point.theta)
                found |= {family: mode} if mode is not None else {}
        return sorted(found.items(), key=lambda pair: pair[1].loss)

    def proposed(self, law: Fitted | None = None) -> list[Proposal]:
        """Return terms to add to the base, or to a law that was fitted."""
        base = law.mode if law else self.base
        present = law.terms if law else ()
        density = self.extended([*self.kinds.values(), *([law.effect] if law else [])])
        names = [kind.name for kind in self.kinds.values()]
        columns = columns_of(density, base, list(self.kinds), names, self.settings.shapes)
        return proposals(density, base, columns, present)

    def fit(self, proposal: Proposal, law: Fitted | None = None) -> Fitted | None:
        """Return a law with all constants fitted; None where no finite force is found."""
        terms = (*(law.terms if law else ()), proposal.column.term)
        text = self.text(terms)
        kind = load(text)
        density = self.extended([kind])
        hypothesis = self.hypothesis.plus(kind.name)
        mode = find_mode(density, hypothesis, self._start(density, hypothesis, kind, proposal, law))
        if mode is None:
            return None
        samples = replace(self.outcome.samples, space=density.space)
        return Fitted(terms, kind, text, density, samples, mode)

    def _start(
        self,
        density: Density,
        hypothesis: Hypothesis,
        kind: type[AbstractEffect],
        proposal: Proposal,
        law: Fitted | None,
    ) -> Array:
        """Return theta (F,) with the term as proposed, beside the law as it was fitted."""
        parameters = density.space.parameters(hypothesis)
        known = (law.mode if law else self.base).point
        theta = transferred(known.own, known.theta, parameters)
        leaves = parameters.by_name
        if law is not None:
            for name, leaf in known.own.by_name.items():
                if name.startswith(f"{law.effect.name}."):
                    own = leaves[f"{kind.name}.{name.partition('.')[2]}1"]
                    theta[list(own.theta)] = known.theta[list(leaf.theta)]
        last, column = "2" if law else "", proposal.column
        for one, value in zip(column.term.shapes, column.shape, strict=True):
            theta[leaves[f"{kind.name}.{one.name}{last}"].theta.start] = value
        theta[leaves[f"{kind.name}.k{last}"].theta.start] = proposal.size * column.sd
        return parameters.within(theta)
