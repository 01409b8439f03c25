"""Define spreading lag: the force is recorded late, and smoothed."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.channel_lag import ChannelLag, joined_with
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.elastic.linear import Linear
from qlvbayes.laws.hereditary import hereditary_force
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_INSTANT = 1e-30  # s, time of a filter that changes nothing and yet has a finite slope


class SpreadingLag(AbstractEffect):
    """Delayed, filtered force: spread delay F' = y - F, y(t) = F_below(t - (1 - spread) delay).

    F = y at first. Before the start the force is that of the start; between the points at which the
    force beneath is taken it lies on straight lines.

    * ``delay``: mean delay of the force's channel (s), zero or more.
    * ``spread``: share of it that is a first-order filter's, from 0 (a pure delay) to 1.
    """

    delay: Constant
    spread: Constant
    name: ClassVar[str] = "spreading_lag"
    level: ClassVar[Level] = ChannelLag.level
    rank: ClassVar[int] = ChannelLag.rank
    units: ClassVar[dict[str, str]] = {"delay": "time", "spread": "fraction"}
    null: ClassVar[dict[str, float]] = {"delay": 0.0}
    costly: ClassVar[bool] = True
    not_stepped: ClassVar[str] = "its filter runs over points that the whole record lays down"
    generalises: ClassVar[str] = ChannelLag.name
    reduces: ClassVar[dict[str, float]] = {"spread": 0.0}
    law: ClassVar[str] = "F(t) -> F(t - (1 - spread) delay), filtered over spread delay"
    seen: ClassVar[str] = "force late against displacement, and its kinks rounded"
    reference: ClassVar[str] = "Oppenheim & Schafer 2010, Discrete-Time Signal Processing, ch. 5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with the delay of channel_lag and a uniform spread."""
        return cls(ChannelLag.default(scales).delay, Uniform(0.0, 1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force beneath at the delayed times, filtered along them."""
        delayed = motion.time - (1.0 - self.spread) * self.delay
        # two more points for each resolve the curvature of the force in between
        before = delayed - self.spread * self.delay
        between = 0.5 * (motion.time[1:] + motion.time[:-1])
        joined, order = joined_with(motion, xp.concatenate([delayed, before, between]))
        force = below.force(joined)
        own = joined.time >= motion.alone.time[0]
        begin = xp.take(force, xp.first_true(own))
        change = xp.where(own, force - begin, 0.0)
        rate = 1.0 / (self.spread * self.delay + _INSTANT)
        filtering = Prony(np.array([1.0, -1.0]), xp.asarray(rate)[None])
        filtered = begin + hereditary_force(Linear(1.0), filtering, joined.time, change)
        return xp.take(filtered, xp.argsort(order)[: motion.time.shape[0]])
