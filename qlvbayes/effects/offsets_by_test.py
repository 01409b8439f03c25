"""Define offsets by test: the load cell's zero differs from test to test."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.spans import LARGEST, curve, duration
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Normal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class OffsetsByTest(AbstractEffect):
    """Offset of each test's force: F = F_below + size (P1 + quadratic P2 + cubic P3).

    The Legendre polynomials are taken at the clock of the test's beginning. With force_offset this
    gives any four tests offsets of their own, and more tests offsets on a smooth curve.

    * ``size``: size of the straight part (N), of either sign.
    * ``quadratic``, ``cubic``: sizes of the curved parts over that of the straight one.
    * ``duration``: duration of the study (s), which is fixed.
    """

    size: Constant
    quadratic: Constant
    cubic: Constant
    duration: Constant
    name: ClassVar[str] = "offsets_by_test"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 3
    units: ClassVar[dict[str, str]] = {
        "size": "force",
        "quadratic": "count",
        "cubic": "count",
        "duration": "time",
    }
    null: ClassVar[dict[str, float]] = {"size": 0.0}
    off_pad: ClassVar[bool] = True
    outside: ClassVar[bool] = True
    not_stepped: ClassVar[str] = (
        "its offset is that of one test of the study, and a step is of none"
    )
    law: ClassVar[str] = "F += size (P1 + quadratic P2 + cubic P3)(start)"
    seen: ClassVar[str] = "all forces of a test shifted alike, each test by its own amount"
    reference: ClassVar[str] = "Abramowitz & Stegun 1964, ch. 22"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a size scaled by the peak force."""
        curved = Normal(0.0, 1.0), Normal(0.0, 1.0)
        return cls(scales.signed(LARGEST), *curved, duration(scales))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force, shifted by the test's offset."""
        shift = curve(motion.start, self.quadratic, self.cubic, self.duration)
        return below.force(motion) + self.size * shift
