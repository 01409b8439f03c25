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
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.starts import Amplitude, amplitude_of, shapes

Array = NDArray[np.float64]

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
    amplitude: Amplitude
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
    starts = shapes(space, point, own, effect)
    found = [_scaled(squares, point, own, amplitude, start) for start in starts]
    return min((one for one in found if one is not None), key=lambda x: x.cost, default=None)


def _scaled(
    squares: Squares, point: Point, own: Parameters, amplitude: Amplitude, start: Array
) -> Beside | None:
    space, number = squares.density.space, amplitude.number
    residual, slopes = squares.residual(point), squares.weighed(point.responses)
    prior = point.prior.curvature
    size, shift, cost = amplitude.sd, np.zeros(point.own.size), np.inf
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
        smallest = _LEAST * amplitude.sd
        scaled = float(np.clip(found[-1] * size, low, high))
        if abs(scaled) < smallest:  # the residual has nothing of it
            scaled, found = smallest if high > 0.0 else -smallest, 0.0 * found
        shift = found[:-1]
        cost = float(np.sum((residual - shift @ slopes - force * (scaled / size)) ** 2))
        size = scaled
    after = start.copy()
    after[number] += size
    moved = after.copy()
    moved[own.positions_of(point.own)] += shift
    return Beside(own, amplitude, start, own.within(after), own.within(moved), cost)
