"""The resolution to which an encoder rounds the displacement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.io.arrays import Array

_LEAST_STEP = 1e-6  # of the range: finer rounding is no encoder's
_DIGITS = 1e-6  # of the range: a record of seven digits has no finer differences
_LARGE = 0.02  # of the range: a step that a movement there and back passes a hundred times,
_PASSED = 20  # changes that show a larger one
_REPEATED = 3  # equal readings in a row: a level,
_LEVELS = 20  # of which so many, each next to another, show how far apart levels are
_WHOLE = 0.95  # of these distances are multiples of the median one: scatter repeats others
_MOST_AVERAGED = 16  # readings whose mean a logger takes: levels farther apart are the motion's


def encoder_step(displacement: Array) -> float:
    """Return the step to which readings were rounded; 0 if there is none or it does not show."""
    step = _lattice(displacement)
    return step * max(averaged(displacement, step), 1)


def _lattice(displacement: Array) -> float:
    """Return the step of which all changes are multiples; 0 if none is visible."""
    span = float(np.ptp(displacement))
    changes = np.diff(displacement)
    sizes = np.abs(changes)
    sizes = np.sort(sizes[sizes > 1e-9 * span])
    if sizes.size < 2:
        return 0.0
    if sizes[-1] - sizes[0] < _DIGITS * max(float(sizes[-1]), span):
        moving = np.abs(changes) > 0.5 * sizes[0]
        alone = (moving[1:-1] != moving[:-2]) & (moving[1:-1] != moving[2:])
        if np.count_nonzero(alone) < (1 if sizes[0] < _LARGE * span else 6):
            return 0.0
    step = float(sizes[0])
    for _ in range(12):
        rest = np.abs(sizes - np.round(sizes / step) * step)
        rest = rest[rest > max(0.05 * step, 1e-9 * span)]
        if rest.size == 0:
            counts = np.round(sizes / step)
            if step < _LEAST_STEP * span or (step > _LARGE * span and sizes.size < _PASSED):
                return 0.0
            return float(sizes @ counts / (counts @ counts))
        step = float(rest.min())
        if step < _LEAST_STEP * span:
            return 0.0
    return 0.0


def encoder_steps(displacements: Sequence[Array]) -> list[float]:
    """Return the step of each of several records by one encoder, 0 where none shows."""
    own = [_lattice(x) for x in displacements]
    least = min((step for step in own if step > 0.0), default=0.0)
    steps = [
        least if least > 0.0 and _divides(least, x) else step
        for step, x in zip(own, displacements, strict=True)
    ]
    means = [averaged(x, step) for step, x in zip(steps, displacements, strict=True)]
    typical = max(means, default=0)
    return [step * max(mean or typical, 1) for step, mean in zip(steps, means, strict=True)]


def averaged(displacement: Array, step: float) -> int:
    """Return how many rounded readings each reading is the mean of; 1 for one, 0 if unknown."""
    if step == 0.0:
        return 0
    change = np.flatnonzero(np.diff(displacement) != 0.0) + 1
    first, stop = np.append(0, change), np.append(change, displacement.size)
    level = stop - first >= _REPEATED
    first, stop = first[level], stop[level]
    next_to = first[1:] - stop[:-1] <= 1
    apart = np.abs(np.diff(displacement[first]))[next_to]
    apart = np.round(apart / step).astype(int)
    apart = apart[apart > 0]
    if apart.size < _LEVELS:
        return 0
    count = int(np.median(apart))
    whole = float(np.mean(apart % count == 0)) >= _WHOLE
    return count if whole and count <= _MOST_AVERAGED else 1


def _divides(step: float, displacement: Array) -> bool:
    """Return whether all changes are multiples of a step."""
    changes = np.abs(np.diff(displacement))
    rest = np.abs(changes - np.round(changes / step) * step)
    return bool(np.all(rest <= max(0.05 * step, 1e-9 * float(np.ptp(displacement)))))
