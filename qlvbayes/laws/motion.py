"""Describe the motion of one test: displacement and its rates on a grid of times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array


class Line(Pytree):
    """Next straight piece of a motion, for a model that is evaluated step by step."""

    duration: Array  # duration (s); 0 is a jump
    displacement: Array  # displacement at the end (mm)
    velocity: Array  # velocity along the line (mm/s); 0 in a jump
    # distance of the platen from the specimen at the end (mm), where displacement is its depth
    clear: ArrayLike = 0.0


class Motion(Pytree):
    """Motion of one test: displacement, linear in time between the points of a grid.

    Arrays have shape (N,) for one test; a leading axis is a batch of tests. Before the first point
    the specimen is at rest at zero displacement; a first point elsewhere is a step.

    Parameters
    ----------
    time
        Time (s), never decreasing; repeated points are allowed and do nothing.
    displacement
        Displacement (mm).
    velocity
        Velocity (mm/s).
    acceleration
        Acceleration (mm/s2).
    start
        Time of the pad's clock at time 0 (s); 0 in the pad's first test.
    ago
        How many tests before this one a point lies, with the pause that follows: 0 in the test
        itself. Velocity and acceleration of earlier tests are set to 0. None where no earlier test
        is included.
    sagitta
        Deviation (mm) of the middle of the step that ends at a point from its straight line, for
        the relaxing modes, where errors of one sign would add up. None for straight lines.
    number
        How many tests the pad has had before, 0 in its first one.
    """

    time: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    start: Array = 0.0
    ago: Array | None = None
    sagitta: Array | None = None
    number: Array = None

    def __post_init__(self) -> None:
        self.start = xp.asarray(self.start)
        first = xp.zeros_like(self.start)
        self.number = first if self.number is None else xp.asarray(self.number)

    @property
    def clock(self) -> Array:
        """Return the time (N,) since the pad's first test began (s)."""
        return self.start + self.time

    @property
    def tests_before(self) -> Array:
        """Return how many tests the pad has had before the one that a point lies in, (N,) or ()."""
        return self.number if self.ago is None else self.number - self.ago

    def followed(self, displacement: Array, rate: Callable[[Array], Array]) -> Motion:
        """Return the motion of what follows this one, at a displacement (N,) of its own.

        ``rate`` gives its velocity, acceleration and sagitta, each from that of this motion.
        """
        return replace(
            self,
            displacement=displacement,
            velocity=rate(self.velocity),
            acceleration=rate(self.acceleration),
            sagitta=None if self.sagitta is None else rate(self.sagitta),
        )

    @property
    def alone(self) -> Motion:
        """Return the test without earlier ones, whose points repeat the test's first point."""
        if self.ago is None:
            return self
        own = self.ago == 0
        begin = xp.first_true(own)

        def held(values: Array) -> Array:
            return xp.where(own, values, xp.take(values, begin))

        sagitta = None if self.sagitta is None else xp.where(own, self.sagitta, 0.0)
        still = self.followed(held(self.displacement), held)
        return replace(still, time=held(self.time), ago=None, sagitta=sagitta)
