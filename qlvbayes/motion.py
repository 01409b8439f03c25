"""What a model sees of one test: displacement and its rates on a grid of times."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array


class Motion(eqx.Module):
    """Displacement, taken as linear in time between the grid's points.

    All four have shape (N,) for one test (a leading axis is a batch of tests): time (s, never
    decreasing; repeated points are allowed and do nothing), displacement (mm), velocity (mm/s),
    acceleration (mm/s2). Before the first point the specimen is at rest at zero displacement; a
    first point elsewhere is a step.
    """

    time: Array
    displacement: Array
    velocity: Array
    acceleration: Array
