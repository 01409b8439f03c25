"""The prior probability of a hypothesis, and the families of effects that share one."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import in_natural_amplitude
from qlvbayes.inference.starts import shapes
from qlvbayes.laws.scales import SHARE

NOTHING = "no effect"
UNLISTED = "something unlisted"
"""Causes that are not the name of an effect."""


@dataclass(frozen=True)
class Families:
    """The families of the effects that a search may add."""

    # name of the family of every effect; a candidate effect's family has its own name
    family_of: dict[str, str]
    # effects that stand for something which no candidate is. They name nothing, and each is a
    # family of its own.
    unmodelled: frozenset[str] = frozenset()

    @classmethod
    def from_kinds(cls, kinds: Iterable[type[AbstractEffect]]) -> Self:
        """Return the families that the classes of effects state."""
        kinds = tuple(kinds)
        return cls(
            {kind.name: kind.family() for kind in kinds},
            frozenset(kind.name for kind in kinds if kind.outside),
        )

    @property
    def nameable(self) -> list[str]:
        """Candidate effects, which a diagnosis may name."""
        return [
            name
            for name, family in self.family_of.items()
            if name == family and name not in self.unmodelled
        ]

    def addable(self, effects: Collection[str]) -> list[str]:
        """Return the effects whose families have no member in a set of effects."""
        taken = {self.family_of[name] for name in effects}
        return [name for name, family in self.family_of.items() if family not in taken]

    def members(self, family: str) -> list[str]:
        """Return the effects of one family."""
        return [name for name, own in self.family_of.items() if own == family]

    def relatives(self, effect: str) -> list[str]:
        """Return every form of an effect."""
        return self.members(self.family_of[effect])

    def forms_in(self, effects: Collection[str]) -> dict[str, str]:
        """Return the form in which each family is in a set of effects."""
        return {
            self.family_of[name]: name for name in sorted(effects) if name not in self.unmodelled
        }

    def cause(self, effects: Collection[str]) -> str:
        """Return the cause that a set of effects stands for: their families, in words."""
        listed = [name for name in effects if name not in self.unmodelled]
        names = sorted({self.family_of.get(name, name) for name in listed})
        unlisted = [UNLISTED] if len(listed) < len(effects) else []
        return " + ".join((*names, *unlisted)) or NOTHING

    def share(self, effect: str, candidate: float) -> float:
        """Return the part of its family's prior probability that an effect has."""
        family = self.family_of[effect]
        forms = [name for name in self.members(family) if name != family]
        has_candidate = family in self.family_of
        own = (candidate if forms else 1.0) if has_candidate else 0.0
        return own if effect == family else (1.0 - own) / len(forms)


def log_prior(
    hypothesis: Hypothesis,
    baseline: Hypothesis,
    laws: tuple[Collection[str], Collection[str]],
    families: Families,
    settings: DiagnosisSettings,
) -> float:
    """Return the log prior probability of a hypothesis: of its laws and its added effects."""
    added = hypothesis.effects - baseline.effects
    taken = {families.family_of[name] for name in baseline.effects}
    chosen = {families.family_of[name] for name in added}
    if len(chosen) < len(added) or chosen & taken:
        return -math.inf
    free = set(families.family_of.values()) - taken
    total = math.log(settings.complete) + len(added) * math.log1p(-settings.complete)
    total -= math.log(math.comb(len(free), len(added)))
    total += sum(math.log(families.share(name, settings.candidate)) for name in added)
    for law, own, known in zip(hypothesis.base, baseline.base, laws, strict=True):
        if len(known) > 1:
            others = (1.0 - settings.chosen_law) / (len(known) - 1)
            total += math.log(settings.chosen_law if law == own else others)
    return total


def log_odds_of_effect(candidates: int, settings: DiagnosisSettings) -> float:
    """Return the log prior odds that one of N candidate effects is in the model."""
    missing = 1.0 - settings.complete
    expected = sum(settings.complete * missing**k * k for k in range(candidates + 1))
    share = min(expected / candidates, 0.5)
    return math.log(share) - math.log1p(-share)


def scale_amplitudes(
    density: Density,
    baseline: Hypothesis,
    point: Point,
    families: Families,
    settings: DiagnosisSettings,
) -> Density:
    """Return a density in which one prior sd of any effect adds 5 % of the largest force."""
    space, signatures, factors = density.space, [], {}
    peak = density.discrepancy.peak
    for name in families.nameable:
        hypothesis = baseline.plus(name)
        own = space.parameters(hypothesis)
        amplitude = own.amplitude_of.get(name)
        if name in baseline.effects or amplitude is None:  # the user gave it a prior
            continue
        starts = shapes(space, point, own, name)
        ends = np.array(list(dict.fromkeys(map(tuple, (starts[0], starts[-1])))))
        for added in space.added_forces(hypothesis, ends, amplitude.number, amplitude.sd):
            largest = float(np.max(np.abs(added[space.real])))
            if largest > 0.0 and math.isfinite(largest):
                signatures.append(added / largest)
                factors[name] = float(
                    np.clip(SHARE * peak / largest, settings.narrowest, settings.widest)
                )
    # a form holds the candidate's law inside, with the same amplitude
    effects = {
        name: in_natural_amplitude(effect, factors[families.family_of[name]])
        for name, effect in space.effects.items()
        if families.family_of[name] in factors
    }
    return density.with_space(space.with_effects({**space.effects, **effects}), signatures)
