"""What a rig can do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from qlvbayes.io.checks import InputError
from qlvbayes.motion.covered import Covered
from qlvbayes.motion.experiment import Experiment

SET_POINTS = 1000.0  # a second: rate of the file of set-points, as of the paper's controller
_SLOWEST = 1e-5  # of the top speed: nobody waits longer


@dataclass(frozen=True)
class Rig:
    """Limits of a test: greatest depth (mm), speed (mm/s) and acceleration (mm/s2).

    interval: between two readings (s) at the least; rows: readings that are kept of a test, of long
    dwells the fewest; done: how many tests the pad has had.
    """

    depth: float
    speed: float
    acceleration: float
    interval: float = 1.0 / SET_POINTS
    rows: int = 10_000_000  # all of them
    done: int = 0

    @classmethod
    def of_tests(cls, experiment: Experiment) -> Rig:
        """What the tests that were done show that it can do, and its logger."""
        scales = experiment.scales
        acceleration = scales.acceleration or scales.speed / (10.0 * scales.shortest)
        rows = max(trial.test.time.size for trial in experiment.trials)
        done = len(experiment.trials)
        return cls(scales.depth, scales.speed, acceleration, scales.shortest, rows, done)

    @classmethod
    def of_ranges(cls, covered: Covered) -> Rig:
        """The same from their ranges: from rest to the fastest rate within half the depth."""
        return cls(covered.depth, covered.fastest, covered.fastest**2 / covered.depth)

    def limited(self, depth: float | None, speed: float | None, acceleration: float | None) -> Rig:
        """With the limits that are given; InputError where one is not above 0."""
        given = {"depth": depth, "speed": speed, "acceleration": acceleration}
        for name, value in given.items():
            if value is not None and not (value > 0.0 and math.isfinite(value)):
                raise InputError(f"--max-{name} is {value:g}", remedy="give it above 0")
        return replace(
            self,
            depth=depth or self.depth,
            speed=speed or self.speed,
            acceleration=acceleration or self.acceleration,
        )

    def slowest(self, longest: float) -> float:
        """Least speed (mm/s) by which a ramp takes a quarter of the longest test (s)."""
        return min(max(_SLOWEST * self.speed, 4.0 * self.depth / longest), self.speed)
