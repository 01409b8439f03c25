"""An effect more beside a model: its amplitude, and where optimising both begins."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.hypothesis import Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.priors.natural import Natural

Array = NDArray[np.float64]

_SHAPES = 4  # quantiles of the prior of an effect's first constant beside its amplitude


class Amplitude(NamedTuple):
    """By which an effect's force grows: places in theta and in the constants, its prior's sd."""

    number: int
    constant: int
    sd: float


def amplitude_of(own: Parameters, effect: str) -> Amplitude | None:
    """Of an effect whose force grows with a number that is taken as it is; None of others."""
    for name, leaf in own.by_name.items():
        if name.startswith(f"{effect}.") and isinstance(leaf.prior, Natural):
            return Amplitude(leaf.theta.start, leaf.constants.start, float(leaf.prior.sd))
    return None


def carried(old: Parameters, theta: Array, new: Parameters, others: Array | None = None) -> Array:
    """Theta (G,) of other numbers: those that both have as they are, the rest as in ``others``.

    others (G,): nothing by default.
    """
    found = np.zeros(new.size) if others is None else others.copy()
    numbers = old.by_name
    for name, leaf in new.by_name.items():
        if name in numbers and len(numbers[name].theta) == len(leaf.theta):
            found[list(leaf.theta)] = theta[list(numbers[name].theta)]
    return found


def shapes(space: Space, point: Point, own: Parameters, effect: str) -> list[Array]:
    """Thetas (G,) of a point with an effect at nothing, its first other constant over its prior."""
    base = carried(point.own, point.theta, own)
    kept = [leaf for name, leaf in own.by_name.items() if name.startswith(f"{effect}.")]
    draws, taken, first = space.draws("effects", effect), 0, None
    for leaf in kept:
        values = draws[:, taken : taken + len(leaf.theta)]
        taken += len(leaf.theta)
        if isinstance(leaf.prior, Natural):
            base[leaf.theta.start] = next(iter(space.effects[effect].null.values()))
            continue
        base[list(leaf.theta)] = np.median(values, axis=0)
        first = first or (leaf, values)
    if first is None:
        return [base]
    found = []
    for share in (np.arange(_SHAPES) + 0.5) / _SHAPES:
        start = base.copy()
        start[list(first[0].theta)] = np.quantile(first[1], share, axis=0)
        found.append(start)
    return found
