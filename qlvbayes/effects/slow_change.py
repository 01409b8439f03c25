"""Define slow change: the scale of the force changes smoothly with the clock."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.effects.clock import AbstractClocked
from qlvbayes.effects.effect import Level
from qlvbayes.effects.spans import LARGEST, curve, duration
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Normal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class SlowChange(AbstractClocked):
    """Slow change of the scale: F = F_below (1 + size (P1 + quadratic P2 + cubic P3)).

    P1, P2 and P3 are Legendre polynomials over the clock.

    * ``size``: size of the straight part (1), of either sign.
    * ``quadratic``, ``cubic``: sizes of the curved parts over that of the straight one.
    * ``duration``: duration of the study (s), which is fixed.
    """

    size: Constant
    quadratic: Constant
    cubic: Constant
    duration: Constant
    name: ClassVar[str] = "slow_change"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {
        "size": "fraction",
        "quadratic": "count",
        "cubic": "count",
        "duration": "time",
    }
    null: ClassVar[dict[str, float]] = {"size": 0.0}
    outside: ClassVar[bool] = True
    law: ClassVar[str] = "F -> F (1 + size (P1 + quadratic P2 + cubic P3)(t))"
    seen: ClassVar[str] = "tests weaker or stronger as the clock runs, not all one way"
    reference: ClassVar[str] = "Abramowitz & Stegun 1964, ch. 22"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a size scaled by the peak force."""
        curved = Normal(0.0, 1.0), Normal(0.0, 1.0)
        return cls(scales.signed(LARGEST * scales.force), *curved, duration(scales))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, its scale changed with the clock."""
        along = curve(clock, self.quadratic, self.cubic, self.duration)
        return force * (1.0 + self.size * along)
