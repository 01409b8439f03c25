"""What a model sees of one test: displacement and its rates on a grid of times."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike


class Line(eqx.Module):
    """The next straight piece of a motion, for a model that goes on step by step.

    duration (s; 0 is a jump), displacement at its end (mm), velocity along it (mm/s; 0 in a jump);
    clear: how far the platen then is off the specimen (mm), known where displacement is its depth.
    """

    duration: Array
    displacement: Array
    velocity: Array
    clear: ArrayLike = 0.0


class Motion(eqx.Module):
    """Displacement, linear in time between the grid's points, or bowed as ``bow`` says.

    The first four have shape (N,) for one test (a leading axis is a batch of tests): time (s, never
    decreasing; repeated points are allowed and do nothing), displacement (mm), velocity (mm/s),
    acceleration (mm/s2). start: the pad's clock at time 0 (s), which is 0 in its first test. Before
    the first point the specimen is at rest at zero displacement; a first point elsewhere is a step.
    bow: (N,) how far the middle of the step that ends at a point is off its straight line (mm), for
    the memory of the material, where an error of one sign would add up; None for straight lines.
    ago: (N,) in which test a point lies, 0 in the test itself, k in the k-th before it with the
    pause that follows (there velocity and acceleration are not told, but 0); None where no earlier
    test is carried along. number: how many tests the pad has had before, 0 in its first one.
    """

    time: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    start: Array
    ago: Array | None
    bow: Array | None
    number: Array

    def __init__(
        self,
        time: Array,
        displacement: Array,
        velocity: Array,
        acceleration: Array,
        start: ArrayLike = 0.0,
        ago: Array | None = None,
        bow: Array | None = None,
        number: ArrayLike | None = None,
    ) -> None:
        self.time, self.displacement = time, displacement
        self.velocity, self.acceleration = velocity, acceleration
        self.start = jnp.asarray(start, dtype=float)
        self.ago, self.bow = ago, bow
        first = jnp.zeros_like(self.start)
        self.number = first if number is None else jnp.asarray(number, dtype=float)

    @property
    def clock(self) -> Array:
        """Time (N,) since the pad's first test began (s)."""
        return self.start + self.time

    @property
    def tests_before(self) -> Array:
        """How many tests the pad has had before the one that a point lies in, (N,) or ()."""
        return self.number if self.ago is None else self.number - self.ago

    @property
    def alone(self) -> Motion:
        """The test without what came before it: those points repeat the test's first one."""
        if self.ago is None:
            return self
        own = self.ago == 0
        begin = jnp.argmax(own)

        def held(values: Array) -> Array:
            return jnp.where(own, values, values[begin])

        return Motion(
            held(self.time),
            held(self.displacement),
            held(self.velocity),
            held(self.acceleration),
            self.start,
            bow=None if self.bow is None else jnp.where(own, self.bow, 0.0),
            number=self.number,
        )
