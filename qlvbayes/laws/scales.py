"""The sizes that default priors are scaled to."""

from __future__ import annotations

import math
from dataclasses import dataclass

from qlvbayes.priors import HalfNormal, LogNormal, Normal

SHARE = 0.05  # prior sd of an effect's largest contribution, over the peak force
TOLERANCE = 0.01
"""Of the peak force: what is smaller does not matter."""


@dataclass(frozen=True)
class Scales:
    """Sizes found in a pad's tests.

    force (N), depth (mm), speed (mm/s), acceleration (mm/s2): largest magnitudes; stiffness (N/mm):
    of the pad where the force is largest; shortest, longest (s): the sampling interval and the
    longest phase; clock (s): from the first test's beginning to the last one's end; white, ou (N)
    and tau (s): the noise floor, measured without the model; white_factor, tau_factor: by which one
    sd of its uncertainty changes white and tau.
    """

    force: float
    depth: float
    shortest: float
    longest: float
    white: float
    ou: float
    tau: float
    speed: float = 1.0
    acceleration: float = 1.0
    clock: float = 1.0
    stiffness: float = 1.0
    white_factor: float = 1.2
    tau_factor: float = 3.0

    @property
    def noise(self) -> float:
        """Sd of one reading (N)."""
        return math.hypot(self.white, self.ou)

    def positive(self, response: float) -> HalfNormal:
        """Prior of an effect's amplitude, zero or more, whose unit adds ``response`` (N) at most.

        All effects share it, so that none wins or loses by a vague prior: the largest contribution
        to the force has a prior sd of 5 % of the peak force.
        """
        return HalfNormal(SHARE * self.force / response)

    def signed(self, response: float) -> Normal:
        """The same for an amplitude of either sign."""
        return Normal(0.0, SHARE * self.force / response)


def lognormal(median: float, factor: float) -> LogNormal:
    """Log-normal with this median and a factor ``factor`` either way for one sd."""
    return LogNormal(math.log(median), math.log(factor))
