"""Where optimising a hypothesis begins, from the mode of one that it neighbours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.inference.projection import projected
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


def shapes(
    space: Space, point: Point, own: Parameters, effect: str, count: int = _SHAPES
) -> list[Array]:
    """Thetas (G,) of a point with an effect at nothing, its first other constant over its prior."""
    return over_shapes(space, own, effect, carried(point.own, point.theta, own), count)


def over_shapes(
    space: Space, own: Parameters, effect: str, theta: Array, count: int = _SHAPES
) -> list[Array]:
    """Theta (G,) with an effect at nothing, its first other constant at quantiles of its prior."""
    base = theta.copy()
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
    for share in (np.arange(count) + 0.5) / count:
        start = base.copy()
        start[list(first[0].theta)] = np.quantile(first[1], share, axis=0)
        found.append(start)
    return found


def starts(
    space: Space, point: Point, hypothesis: Hypothesis, count: int, sizes: tuple[float, float]
) -> list[Array]:
    """Thetas (F,) from which a hypothesis is optimised, given a mode of one that it neighbours.

    What both have is carried over, another law is as like as it can be, and a new effect is small
    and large, its shape at so many quantiles of its prior.

    sizes: small and large, in sds of an amplitude's prior.
    """
    own = space.parameters(hypothesis)
    base = projected(space, point, hypothesis, carried(point.own, point.theta, own))
    found = [base]
    for effect in sorted(hypothesis.effects - point.own.hypothesis.effects):
        found = [
            theta
            for start in found
            for theta in _small_and_large(space, own, effect, start, count, sizes)
        ]
    return found


def _small_and_large(
    space: Space,
    own: Parameters,
    effect: str,
    theta: Array,
    count: int,
    sizes: tuple[float, float],
) -> list[Array]:
    """Theta (F,) with an effect of each of some sizes, every shape small before any is large."""
    places = over_shapes(space, own, effect, theta, count)
    amplitude = amplitude_of(own, effect)
    if amplitude is None:
        return places
    signed = own.lowest[amplitude.number] == -np.inf
    found = []
    for size in (*sizes, -sizes[1]) if signed else sizes:
        for place in places:
            start = place.copy()
            start[amplitude.number] += size * amplitude.sd
            found.append(start)
    return found
