"""What a model sees of one test: displacement and its rates on a grid of times."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike


class Motion(eqx.Module):
    """Displacement, taken as linear in time between the grid's points.

    The first four have shape (N,) for one test (a leading axis is a batch of tests): time (s, never
    decreasing; repeated points are allowed and do nothing), displacement (mm), velocity (mm/s),
    acceleration (mm/s2). start: the pad's clock at time 0 (s), which is 0 in its first test. Before
    the first point the specimen is at rest at zero displacement; a first point elsewhere is a step.
    """

    time: Array
    displacement: Array
    velocity: Array
    acceleration: Array
    start: Array

    def __init__(
        self,
        time: Array,
        displacement: Array,
        velocity: Array,
        acceleration: Array,
        start: ArrayLike = 0.0,
    ) -> None:
        self.time, self.displacement = time, displacement
        self.velocity, self.acceleration = velocity, acceleration
        self.start = jnp.asarray(start, dtype=float)

    @property
    def clock(self) -> Array:
        """Time (N,) since the pad's first test began (s)."""
        return self.start + self.time
