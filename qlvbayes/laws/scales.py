"""Define the scales of a study's tests, which set the widths of default priors."""

from __future__ import annotations

import math
from dataclasses import dataclass

from qlvbayes.priors import HalfNormal, LogNormal, Normal

SHARE = 0.05  # prior sd of an effect's largest contribution to the force, over the peak force
TOLERANCE = 0.01
"""Share of the peak force below which a difference is negligible."""


@dataclass(frozen=True)
class Scales:
    """Scales measured in a pad's tests: force, depth, times, noise, speed and stiffness."""

    force: float  # largest force (N)
    depth: float  # largest depth (mm)
    shortest: float  # sampling interval (s)
    longest: float  # duration of the longest phase (s)
    # white, ou: standard deviations (N) of the white and of the correlated part of the noise floor,
    # measured without the model
    white: float
    ou: float
    tau: float  # correlation time (s) of the correlated part
    # speed, acceleration: largest speed (mm/s) and acceleration (mm/s2)
    speed: float = 1.0
    acceleration: float = 1.0
    clock: float = 1.0  # time (s) from the first test's beginning to the last one's end
    stiffness: float = 1.0  # stiffness (N/mm) of the pad where the force is largest
    # white_factor, tau_factor: factors by which one sd of their uncertainty changes ``white`` and
    # ``tau``
    white_factor: float = 1.2
    tau_factor: float = 3.0
    # mass (N s2/mm) that impulses at starts and stops show beyond doubt, and its standard error
    mass: tuple[float, float] | None = None

    @property
    def noise(self) -> float:
        """Return the standard deviation (N) of one reading's noise."""
        return math.hypot(self.white, self.ou)

    @property
    def top_speed(self) -> float:
        """Return the largest speed (mm/s), or a guess where none is known."""
        return self.speed if self.speed > 0.0 else 1.0

    def positive(self, response: float) -> HalfNormal:
        """Return the prior of an amplitude from zero, one unit of which adds ``response`` (N)."""
        return HalfNormal(SHARE * self.force / response)

    def signed(self, response: float) -> Normal:
        """Return the same prior for an amplitude of either sign."""
        return Normal(0.0, SHARE * self.force / response)


def lognormal(median: float, factor: float) -> LogNormal:
    """Return the log-normal prior with this median; one sd is a factor of ``factor`` either way."""
    return LogNormal(math.log(median), math.log(factor))
