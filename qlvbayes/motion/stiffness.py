"""The pad's stiffness, measured without a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.io.data import Test

_LAST = 0.25  # of the way to the largest force, where the slope is taken


def largest_stiffness(tests: Sequence[Test]) -> float:
    """Return the slope (N/mm) of the force over the last quarter of the way to its maximum.

    At least the secant's, which also stands where the way has too few points there or the force is
    largest at a small depth.
    """
    depth = max(float(np.max(np.abs(test.displacement))) for test in tests)
    hardest = max(tests, key=lambda test: float(np.max(np.abs(test.force))))
    peak = int(np.argmax(np.abs(hardest.force)))
    travel, force = (np.abs(x[: peak + 1]) for x in (hardest.displacement, hardest.force))
    secant = float(force[-1]) / depth
    last = travel >= (1.0 - _LAST) * travel[-1]
    spread = travel[last] - np.mean(travel[last])
    if travel[-1] < _LAST * depth or not np.any(spread):
        return secant
    return max(float(spread @ force[last] / (spread @ spread)), secant)
