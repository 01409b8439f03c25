"""Places about a fit from which it is fitted again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.forward.space import Space

Array = NDArray[np.float64]

_FAR = 0.2  # of a number's natural length, one sd


def around(
    space: Space, hypothesis: Hypothesis, theta: Array, *, redrawn: int, moved: int, seed: int = 0
) -> list[Array]:
    """Theta (F,) itself, with its relaxation drawn anew from the prior, and all numbers moved."""
    own = space.parameters(hypothesis)
    found = [own.within(theta)]
    relaxing = space.indices_of(hypothesis, "relaxation")
    for drawn in space.draws_of(hypothesis, "relaxation")[:redrawn]:
        start = found[0].copy()
        start[relaxing] = drawn
        found.append(start)
    steps = np.random.default_rng(seed).standard_normal((moved, own.size))
    return found + list(own.within(theta + _FAR * own.length * steps))
