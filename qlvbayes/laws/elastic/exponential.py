"""Stiffness exponential in depth, from first contact on or beyond a linear toe."""

from __future__ import annotations

from typing import Self

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.laws.smoothmath import exp_difference_ratio, exp_growth
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class Exponential(AbstractElastic):
    """Stiffness exponential in depth: F_e = (m/b)(e^{b delta} - 1), the paper's Eq. 8.

    At b = 0 the law is linear, F_e = m delta.
    """

    m: Constant = constant("stiffness", "stiffness at first contact, before anything relaxes")
    b: Constant = constant("exponent", "how fast stiffness grows with depth")
    name = "exponential"
    law = "K(δ) = m exp(b δ)"
    reference = "Fung 1967, doi:10.1152/ajplegacy.1967.213.6.1532"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        return cls(stiffness, lognormal(1.0 / scales.depth, 5.0))

    def force(self, depth: Array) -> Array:
        return self.m * exp_growth(depth, self.b)

    def stiffness(self, depth: Array) -> Array:
        return self.m * xp.exp(self.b * depth)

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        travel = stop - start
        begun, ended = self.m + self.b * force_start, self.m + self.b * force_stop
        return Rise((), (self.b * travel, travel * begun, travel * ended))


class ToeExponential(AbstractElastic):
    r"""Elastic force linear to the depth ``toe`` and exponential beyond, with one slope there.

    .. math:: F_e = m \delta, \quad \delta \le d; \qquad
              F_e = m d + \frac{m}{b}(e^{b (\delta - d)} - 1), \quad \delta > d
    """

    m: Constant = constant("stiffness", "stiffness of the toe, before anything relaxes")
    b: Constant = constant("exponent", "how fast stiffness grows beyond the toe")
    toe: Constant = constant("displacement", "depth at which it begins to stiffen")
    name = "toe"
    law = "K(δ) = m exp(b max(δ − toe, 0))"
    reference = "Fung 1993, doi:10.1007/978-1-4757-2257-4"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        toe = lognormal(0.2 * scales.depth, 2.0)
        return cls(stiffness, lognormal(1.0 / scales.depth, 5.0), toe)

    def force(self, depth: Array) -> Array:
        beyond = xp.maximum(depth - self.toe, 0.0)
        return self.m * (xp.minimum(depth, self.toe) + exp_growth(beyond, self.b))

    def stiffness(self, depth: Array) -> Array:
        return self.m * xp.exp(self.b * xp.maximum(depth - self.toe, 0.0))

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        travel = stop - start
        in_toe = xp.minimum(stop, self.toe) - xp.minimum(start, self.toe)
        moves = travel != 0.0
        share = xp.where(moves, in_toe / xp.where(moves, travel, 1.0), start <= self.toe)
        decay_toe, decay_beyond = share * decay, (1.0 - share) * decay
        left_toe, left_beyond = xp.exp(-decay_toe), xp.exp(-decay_beyond)
        toe = self.m * in_toe * exp_difference_ratio(1.0, left_toe, decay_toe)
        first, last = self.stiffness(start), self.stiffness(stop)
        beyond = travel - in_toe
        beyond *= exp_difference_ratio(last, first * left_beyond, self.b * beyond + decay_beyond)
        # the part that is passed first decays through the rest of the step
        return xp.where(travel >= 0.0, toe * left_beyond + beyond, toe + beyond * left_toe)
