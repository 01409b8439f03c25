"""Draws of the constants of every hypothesis that a diagnosis left, as many as it is likely.

A hypothesis's constants are taken as normal about its mode, in the parameters and within the bounds
in which the diagnosis computed its evidence, and many hypotheses as their mixture (Hoeting et al.
1999, doi:10.1214/ss/1009212519). The stiffness and the strengths of effects may differ from test to
test: those of a new test are drawn about the constants when a program is predicted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import msgspec
import numpy as np

from qlvbayes.comparison.side import Side
from qlvbayes.diagnosis.result import LawPair
from qlvbayes.diagnosis.summary.diagnosis import Diagnosis
from qlvbayes.io.files import Part, Result
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.choices import Choices
from qlvbayes.motion.facts import Covered, covered

FILE = "hypotheses.json"
DRAWS = 400  # of all hypotheses together
_OF_CURVE = 200  # of each hypothesis, for moments to some per cent


class DrawnHypothesis(Part, frozen=True):
    """Laws and effects, as in diagnosis.json; constants: draws (n,) of each by its name."""

    base: LawPair
    effects: tuple[str, ...]
    probability: float  # posterior, over all hypotheses that were seen
    constants: dict[str, tuple[float, ...]]
    # relative sds between tests of stiffness and strengths
    scatter: dict[str, float] = msgspec.field(default_factory=dict)
    # draws of each constant as the curve follows the data, without what a discrepancy may have
    # moved it by: with their moments the next test is planned. Empty in older files
    curve: dict[str, tuple[float, ...]] = msgspec.field(default_factory=dict)

    def __str__(self) -> str:
        """Return it as ``hertz with prony:2 + friction (0.61)``."""
        return f"{' + '.join((str(self.base), *self.effects))} ({self.probability:.2f})"


class Hypotheses(Result, frozen=True, kw_only=True):
    """The hypotheses that a diagnosis left, likeliest first: ``hypotheses.json``.

    choices: Choices of the diagnosis; each hypothesis has laws of its own and further effects;
    covered: Range of depths, rates and times that the tests cover; hypotheses: Draws of each.
    """

    indent: ClassVar[int | None] = None
    pad: str
    units: UnitSystem = PAD
    choices: Choices
    covered: Covered
    hypotheses: tuple[DrawnHypothesis, ...]

    @property
    def probability(self) -> float:
        """Probability of all of them together; many unlikely ones share the rest."""
        return sum(one.probability for one in self.hypotheses)

    @property
    def says_more(self) -> bool:
        """True if a fit, which is one model without scatter between tests, would say too little."""
        return len(self.hypotheses) > 1 or any(one.scatter for one in self.hypotheses)

    def side(self, one: DrawnHypothesis) -> Side:
        """Return one of the hypotheses as draws of a model."""
        name, _, modes = one.base.relaxation.partition(":")
        choices = replace(
            self.choices,
            elastic=one.base.elastic,
            relaxation=name,
            modes=int(modes) if name == Prony.name and modes else self.choices.modes,
            effects=(*self.choices.effects, *one.effects),
            priors=(),
            fixed=(),
        )
        names, draws = tuple(one.constants), np.stack([*map(np.array, one.constants.values())], 1)
        known = self.units, self.covered
        return Side(self.pad, names, draws, choices, *known, scatter=one.scatter)


def drawn_hypotheses(
    diagnosis: Diagnosis, choices: Choices, *, draws: int = DRAWS, seed: int = 0
) -> Hypotheses:
    """Return draws of every hypothesis in ``diagnosis.result.alternatives``, under ``choices``."""
    work, rng = diagnosis.work, np.random.default_rng(seed)
    seen = {
        (one.hypothesis.base, tuple(work.search.added(one.hypothesis))): one
        for one in work.search.candidates.values()
    }
    alternatives = diagnosis.result.alternatives
    total = sum(one.probability for one in alternatives)
    drawn = []
    for one in alternatives:
        candidate = seen[one.base.pair, one.effects]
        count = max(round(draws * one.probability / total), 1)
        again = np.random.default_rng(seed)  # the draws that predict do not depend on the others
        every = candidate.draws(count, rng), candidate.draws(_OF_CURVE, again, moved=False)
        kept, curve = ({k: tuple(x.tolist()) for k, x in some.items()} for some in every)
        known = one.base, one.effects, one.probability, kept, candidate.scatter, curve
        drawn.append(DrawnHypothesis(*known))
    return Hypotheses(
        pad=diagnosis.result.pad,
        units=diagnosis.result.units,
        choices=choices,
        covered=covered(work.experiment),
        hypotheses=tuple(drawn),
    )
