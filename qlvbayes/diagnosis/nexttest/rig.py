"""The limits of a rig."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from qlvbayes.io.checks import InputError
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.facts import Covered

SET_POINTS = 1000.0
"""Set-points a second in the file for the rig, as the paper's controller takes them."""
_SLOWEST = 1e-5  # least share of the top speed: slower tests take too long


@dataclass(frozen=True)
class Rig:
    """The limits of a test on a rig."""

    # depth, speed, acceleration: greatest depth (mm), speed (mm/s) and acceleration (mm/s2)
    depth: float
    speed: float
    acceleration: float
    interval: float = 1.0 / SET_POINTS  # least time between two readings (s)
    # number of readings that are kept of a test; long dwells lose readings first
    rows: int = 10_000_000  # no logger keeps fewer
    done: int = 0  # number of tests that the pad has had

    @classmethod
    def from_tests(cls, experiment: Experiment) -> Rig:
        """Return the limits that the tests reached, and those of their logger."""
        scales = experiment.scales
        acceleration = scales.acceleration or scales.speed / (10.0 * scales.shortest)
        rows = max(trial.test.time.size for trial in experiment.trials)
        done = len(experiment.trials)
        return cls(scales.depth, scales.speed, acceleration, scales.shortest, rows, done)

    @classmethod
    def from_ranges(cls, covered: Covered) -> Rig:
        """Return the limits from the ranges that the tests cover."""
        return cls(covered.depth, covered.fastest, covered.fastest**2 / covered.depth)

    def limited(self, depth: float | None, speed: float | None, acceleration: float | None) -> Rig:
        """Return the rig with the limits that are given."""
        given = {"depth": depth, "speed": speed, "acceleration": acceleration}
        for name, value in given.items():
            if value is not None and not (value > 0.0 and math.isfinite(value)):
                raise InputError(f"--limits {name}={value:g}", remedy="give it above 0")
        return replace(
            self,
            depth=depth or self.depth,
            speed=speed or self.speed,
            acceleration=acceleration or self.acceleration,
        )

    def slowest(self, longest: float) -> float:
        """Return the speed (mm/s) at which a ramp takes a quarter of the longest test (s)."""
        return min(max(_SLOWEST * self.speed, 4.0 * self.depth / longest), self.speed)
