"""Stiffness exponential in depth, from first contact on or beyond a linear toe."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.laws.smoothmath import exp_difference_ratio, exp_growth
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Exponential(AbstractElastic):
    """Stiffness exponential in depth: F_e = (m/b)(e^{b delta} - 1), the paper's Eq. 8.

    At b = 0 the law is linear, F_e = m delta.

    Parameters
    ----------
    m
        Stiffness at first contact (N/mm).
    b
        Growth of the logarithm of stiffness with depth (1/mm).

    References
    ----------
    Fung 1967, doi:10.1152/ajplegacy.1967.213.6.1532
    """

    m: Constant
    b: Constant
    name: ClassVar[str] = "exponential"
    units: ClassVar[dict[str, str]] = {"m": "stiffness", "b": "exponent"}
    meanings: ClassVar[dict[str, str]] = {
        "m": "stiffness at first contact, before anything relaxes",
        "b": "how fast stiffness grows with depth",
    }
    law: ClassVar[str] = "K(δ) = m exp(b δ)"
    reference: ClassVar[str] = "Fung 1967, doi:10.1152/ajplegacy.1967.213.6.1532"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors: m near the secant stiffness, b near 1/depth."""
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        return cls(stiffness, lognormal(1.0 / scales.depth, 5.0))

    def force(self, depth: Array) -> Array:
        """Return F_e = (m/b)(e^{b depth} - 1)."""
        return self.m * exp_growth(depth, self.b)

    def stiffness(self, depth: Array) -> Array:
        """Return K = m e^{b depth}."""
        return self.m * xp.exp(self.b * depth)

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        """Return dd K(d0) e^{b dd s}."""
        travel = stop - start
        begun, ended = self.m + self.b * force_start, self.m + self.b * force_stop
        return Rise((), (self.b * travel, travel * begun, travel * ended))


class ToeExponential(AbstractElastic):
    r"""Elastic force linear to the depth ``toe`` and exponential beyond, with one slope there.

    .. math:: F_e = m \delta, \quad \delta \le d; \qquad
              F_e = m d + \frac{m}{b}(e^{b (\delta - d)} - 1), \quad \delta > d

    Parameters
    ----------
    m
        Stiffness of the toe (N/mm).
    b
        Growth of the logarithm of stiffness with depth beyond the toe (1/mm).
    toe
        Depth d at which stiffening begins (mm), zero or more.

    References
    ----------
    Fung 1993, doi:10.1007/978-1-4757-2257-4
    """

    m: Constant
    b: Constant
    toe: Constant
    name: ClassVar[str] = "toe"
    units: ClassVar[dict[str, str]] = {"m": "stiffness", "b": "exponent", "toe": "displacement"}
    meanings: ClassVar[dict[str, str]] = {
        "m": "stiffness of the toe, before anything relaxes",
        "b": "how fast stiffness grows beyond the toe",
        "toe": "depth at which it begins to stiffen",
    }
    law: ClassVar[str] = "K(δ) = m exp(b max(δ − toe, 0))"
    reference: ClassVar[str] = "Fung 1993, doi:10.1007/978-1-4757-2257-4"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors: m and b as in `Exponential`, and a short toe."""
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        toe = lognormal(0.2 * scales.depth, 2.0)
        return cls(stiffness, lognormal(1.0 / scales.depth, 5.0), toe)

    def force(self, depth: Array) -> Array:
        """Return F_e, which is continuous and has a continuous slope."""
        beyond = xp.maximum(depth - self.toe, 0.0)
        return self.m * (xp.minimum(depth, self.toe) + exp_growth(beyond, self.b))

    def stiffness(self, depth: Array) -> Array:
        """Return K = m e^{b max(depth - toe, 0)}."""
        return self.m * xp.exp(self.b * xp.maximum(depth - self.toe, 0.0))

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Return the exact step: its parts in the toe and beyond, each with its share of time."""
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
