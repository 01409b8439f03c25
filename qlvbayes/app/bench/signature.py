"""Compute what an effect would add: its force, scaled to the residual by least squares.

With J the slopes of the model's own constants and g the force of the effect of unit size, both over
the noise, shift d and size a minimise

.. math:: |r - J^T d - a g|^2 - d^T P d,

P the curvature of the constants' priors. The size is inserted into g a few times, as few effects
are linear in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.inference.density import Density, Point
from qlvbayes.inference.forward.hypothesis import Amplitude, Hypothesis, Parameters
from qlvbayes.inference.starts import shapes
from qlvbayes.io.arrays import Array

_ROUNDS = 3  # times that the size is inserted into the force
_LEAST = 1e-6  # smallest size over the prior's sd, which stands for zero


@dataclass(frozen=True, eq=False)
class AddedEffect:
    """Model at theta (F,) with one more effect, at the effect's most probable size and shape.

    ``own`` are the parameters of the model with the effect, and ``amplitude`` is the effect's among
    them. ``before`` and ``after`` (G,) have the amplitude at zero and at its size, with the
    constants unchanged; ``moved`` (G,) includes the constants' shift. ``cost`` is the remaining sum
    of squares.
    """

    own: Parameters
    amplitude: Amplitude
    before: Array
    after: Array
    moved: Array
    cost: float


def added_effect(
    density: Density, point: Point, hypothesis: Hypothesis, effect: str
) -> AddedEffect | None:
    """Return an additional effect at a point, in the shape that takes most of the residual."""
    space = density.space
    own = space.parameters(hypothesis)
    amplitude = own.amplitude_of.get(effect)
    if amplitude is None:
        return None
    starts = shapes(space, point, own, effect)
    candidates = [_scaled(density, point, own, amplitude, start) for start in starts]
    return min(
        (candidate for candidate in candidates if candidate is not None),
        key=lambda x: x.cost,
        default=None,
    )


def _scaled(
    density: Density, point: Point, own: Parameters, amplitude: Amplitude, start: Array
) -> AddedEffect | None:
    index, residual, slopes = amplitude.number, point.residual, point.jacobian
    prior = point.prior.curvature
    size, shift, cost = amplitude.sd, np.zeros(point.own.size), np.inf
    for _ in range(_ROUNDS):
        added = density.space.added_forces(own.hypothesis, start[None], index, size)
        force = density.whitener(added)[0]
        square = float(force @ force)
        if not (np.isfinite(square) and square > 0.0):
            return None
        rows = np.concatenate([slopes, force[None]])
        matrix = rows @ rows.T
        matrix[:-1, :-1] += prior
        scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        solution = (
            scale
            * np.linalg.lstsq(
                matrix * np.outer(scale, scale), scale * (rows @ residual), rcond=1e-12
            )[0]
        )
        low, high = own.lowest[index] - start[index], own.highest[index] - start[index]
        smallest = _LEAST * amplitude.sd
        scaled = float(np.clip(solution[-1] * size, low, high))
        if abs(scaled) < smallest:  # the residual has nothing of it
            scaled, solution = smallest if high > 0.0 else -smallest, 0.0 * solution
        shift = solution[:-1]
        cost = float(np.sum((residual - shift @ slopes - force * (scaled / size)) ** 2))
        size = scaled
    after = start.copy()
    after[index] += size
    moved = after.copy()
    moved[own.positions_of(point.own)] += shift
    return AddedEffect(own, amplitude, start, own.within(after), own.within(moved), cost)
