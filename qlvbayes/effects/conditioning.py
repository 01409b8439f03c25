"""Define conditioning: each test leaves the pad weaker for the next ones, less and less so."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_TESTS = (0.3, 5.0)
"""Bounds of the number of tests over which it is conditioned: the first one or a few.

Where it takes more tests than a study has, each weakens it alike, which is fluid_leak: of tests at
even intervals all but 4 % of the force is the leak's at 20 tests. The leak has a constant less.
"""


class Conditioning(AbstractEffect):
    """Weakening with each test: F = F_below (1 - share (1 - e^{-n/tests})), n tests before.

    Within a test nothing is lost, however long it takes.

    * ``share``: share of the force that is lost in the end, zero or more.
    * ``tests``: number of tests after which 63 % of that is lost, above 0.
    """

    share: Constant
    tests: Constant
    name: ClassVar[str] = "conditioning"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 4
    units: ClassVar[dict[str, str]] = {"share": "fraction", "tests": "count"}
    null: ClassVar[dict[str, float]] = {"share": 0.0}
    not_stepped: ClassVar[str] = "it changes from test to test, and steps are of one test"
    law: ClassVar[str] = "F -> F (1 - share (1 - e^(-n/tests))), n tests before"
    seen: ClassVar[str] = "the first test strongest, each later one weaker, then all alike"
    reference: ClassVar[str] = "Fung 1993, Biomechanics, ch. 7.5, preconditioning"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a share scaled by the peak force."""
        return cls(scales.positive(scales.force), LogUniform(*_TESTS))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force, weakened by the tests before."""
        lost = -self.share * xp.expm1(-motion.tests_before / self.tests)
        return below.force(motion) * (1.0 - lost)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: it needs more than one test."""
        return None if protocol.tests > 1 else "there is only one test"
