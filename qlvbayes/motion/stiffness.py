"""The pad's largest force and its stiffness, measured without a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from qlvbayes.io.data import Test

_LAST = 0.25  # of the way to the largest force, where the slope is taken
_CLEAR = 5.0  # of the sds of readings around it, above which a force is no noise
_AROUND = 21  # readings


def largest_force(test: Test) -> float:
    """Return the largest magnitude of the force (N), noise aside."""
    return float(np.max(np.where(_clear(test), np.abs(test.force), 0.0)))


def _clear(test: Test) -> NDArray[np.bool_]:
    """Return which readings are larger than their own noise, all if none is or none is known."""
    every = np.ones(test.force.size, dtype=bool)
    if test.force_sd is None:
        return every
    around = maximum_filter1d(test.force_sd, _AROUND)  # where noise ends its sd is not sharp
    clear = np.abs(test.force) > _CLEAR * around
    return clear if clear.any() else every


def largest_stiffness(tests: Sequence[Test]) -> float:
    """Return the slope (N/mm) of the force over the last quarter of the way to its maximum."""
    depth = max(float(np.max(np.abs(test.displacement))) for test in tests)
    hardest = max(tests, key=largest_force)
    clear = _clear(hardest)
    peak = int(np.argmax(np.where(clear, np.abs(hardest.force), 0.0)))
    travel, force = (np.abs(x[: peak + 1]) for x in (hardest.displacement, hardest.force))
    secant = float(force[-1]) / depth
    last = clear[: peak + 1] & (travel >= (1.0 - _LAST) * travel[-1])
    spread = travel[last] - np.mean(travel[last])
    if travel[-1] < _LAST * depth or not np.any(spread):
        return secant
    return max(float(spread @ force[last] / (spread @ spread)), secant)
