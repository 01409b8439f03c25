r"""What an effect would look like: the force it adds, scaled to the residual by least squares.

With J the slopes of the model's own constants and g the force of the effect of unit size, both over
the noise, shift d and size a minimise

.. math:: |r - J^T d - a g|^2 - d^T P d,

P the curvature of the constants' priors. The size goes back into g a few times, as few effects are
linear in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.app.bench.squares import Squares
from qlvbayes.inference.density import Point
from qlvbayes.inference.space import Hypothesis, Leaf, Parameters
from qlvbayes.priors.natural import Natural

Array = NDArray[np.float64]

_SHAPES = 4  # quantiles of the prior of an effect's first constant beside its amplitude
_ROUNDS = 3  # in which the size goes back into the force
_LEAST = 1e-6  # of the prior's sd: a size that stands for none


@dataclass(frozen=True, eq=False)
class Beside:
    """A model at theta (F,), and an effect beside it at its likeliest size and shape.

    own: numbers of the model with the effect; amplitude: its place among them; before, after (G,):
    with the amplitude at nothing and at its size, the constants as they are; moved (G,): with the
    constants' shift too; cost: sum of squares that this leaves.
    """

    own: Parameters
    amplitude: Leaf
    before: Array
    after: Array
    moved: Array
    cost: float


def beside(squares: Squares, point: Point, hypothesis: Hypothesis, effect: str) -> Beside | None:
    """An effect more at a place: of its shapes the one that takes most of the residual.

    None where the effect has no amplitude that is taken as it is, or none of its forces is finite.
    """
    space = squares.density.space
    own = space.parameters(hypothesis)
    amplitude = amplitude_of(own, effect)
    if amplitude is None:
        return None
    starts = shapes(squares, point, own, effect)
    found = [_scaled(squares, point, own, amplitude, start) for start in starts]
    return min((one for one in found if one is not None), key=lambda x: x.cost, default=None)


def amplitude_of(own: Parameters, effect: str) -> Leaf | None:
    """The number by which an effect's force grows, where it is taken as it is."""
    for name, leaf in own.by_name.items():
        if name.startswith(f"{effect}.") and isinstance(leaf.prior, Natural):
            return leaf
    return None


def shapes(squares: Squares, point: Point, own: Parameters, effect: str) -> list[Array]:
    """Thetas (G,) with the effect at nothing, its first other constant over its prior."""
    space = squares.density.space
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


def carried(old: Parameters, theta: Array, new: Parameters) -> Array:
    """Theta (G,) of other numbers, those that both have as they are, the others at zero."""
    found, numbers = np.zeros(new.size), old.by_name
    for name, leaf in new.by_name.items():
        if name in numbers and len(numbers[name].theta) == len(leaf.theta):
            found[list(leaf.theta)] = theta[list(numbers[name].theta)]
    return found


def _scaled(
    squares: Squares, point: Point, own: Parameters, amplitude: Leaf, start: Array
) -> Beside | None:
    space, number = squares.density.space, amplitude.theta.start
    residual, slopes = squares.residual(point), squares.weighed(point.responses)
    prior = point.prior.curvature
    assert isinstance(amplitude.prior, Natural)
    size, shift, cost = amplitude.prior.sd, np.zeros(point.own.size), np.inf
    for _ in range(_ROUNDS):
        force = squares.weighed(space.added_force(own.hypothesis, start, number, size))
        square = float(force @ force)
        if not (np.isfinite(square) and square > 0.0):
            return None
        rows = np.concatenate([slopes, force[None]])
        matrix = rows @ rows.T
        matrix[:-1, :-1] += prior
        scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        found = (
            scale
            * np.linalg.lstsq(
                matrix * np.outer(scale, scale), scale * (rows @ residual), rcond=1e-12
            )[0]
        )
        low, high = own.lowest[number] - start[number], own.highest[number] - start[number]
        smallest = _LEAST * amplitude.prior.sd
        scaled = float(np.clip(found[-1] * size, low, high))
        if abs(scaled) < smallest:  # the residual has nothing of it
            scaled, found = smallest if high > 0.0 else -smallest, 0.0 * found
        shift = found[:-1]
        cost = float(np.sum((residual - shift @ slopes - force * (scaled / size)) ** 2))
        size = scaled
    after = start.copy()
    after[number] += size
    moved = after.copy()
    moved[own.carried(point.own)] += shift
    return Beside(own, amplitude, start, own.within(after), own.within(moved), cost)
