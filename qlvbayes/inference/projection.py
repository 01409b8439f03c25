"""Another law as like as it can be: its constants fitted to a law's curve, without any force.

An elastic law is known by its force over depth, a relaxation by its curve over the logarithm of
time. Where one law takes another's place, optimising starts from the nearest of its curves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import Space

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]

_CLOSE = 0.01  # of the curve's largest value, by which it may be missed as gladly as a prior's sd
_STARTS = 2  # draws of the priors, the median first
_CALLS = 15  # of the curve at most: what comes after is for the force to settle
_ENOUGH = 1e-3  # relative fall of the cost in a step, at which it is near enough
_STEP = 1e-6  # over which slopes are taken


def projected(space: Space, point: Point, hypothesis: Hypothesis, theta: Array) -> Array:
    """Theta (F,) with the numbers of its laws such that their curves are the point's.

    A law that both have keeps what stands in theta.
    """
    found = theta
    for part in ("elastic", "relaxation"):
        if getattr(hypothesis, part) == getattr(point.own.hypothesis, part):
            continue  # what both have stays
        goal = space.curve(point.own.hypothesis, part, point.constants[None])[0]
        found = with_curve(space, hypothesis, part, goal, found)
    return found


def with_curve(space: Space, hypothesis: Hypothesis, part: str, goal: Array, theta: Array) -> Array:
    """Theta (F,) with the numbers of one of its laws such that its curve is near a goal (40,).

    part: ``elastic`` or ``relaxation``; goal: as `Space.curve` gives it.
    """
    numbers = space.numbers_of(hypothesis, part)
    if not numbers:
        return theta
    own, found = space.parameters(hypothesis), theta.copy()
    curve = _curve(space, own, part, theta, numbers)
    found[numbers] = _fitted(curve, goal, space.draws_of(hypothesis, part), own, numbers)
    return found


def _curve(
    space: Space, own: Parameters, part: str, theta: Array, numbers: list[int]
) -> Callable[[Array], Array]:
    """Curves (K, places) of some of theta's numbers (K, count)."""

    def curve(some: Array) -> Array:
        thetas = np.tile(theta, (len(some), 1))
        thetas[:, numbers] = some
        return space.curve(own.hypothesis, part, own.constants(thetas))

    return curve


def _fitted(curve: Curve, goal: Array, draws: Array, own: Parameters, numbers: list[int]) -> Array:
    """Numbers whose curve is nearest to a goal (places,), kept near their priors' draws."""
    middle, spread = np.median(draws, axis=0), np.maximum(draws.std(axis=0), _STEP)
    close = _CLOSE * float(np.max(np.abs(goal)))
    steps = _STEP * np.eye(middle.size)

    def residual(x: Array) -> Array:
        return np.concatenate([(curve(x[None])[0] - goal) / close, (x - middle) / spread])

    def slopes(x: Array) -> Array:
        rows = curve(np.concatenate([x[None], x + steps]))
        return np.concatenate([(rows[1:] - rows[0]).T / (_STEP * close), np.diag(1.0 / spread)])

    bounds = own.lowest[numbers], own.highest[numbers]
    inside = [np.clip(x, *bounds) for x in (middle, *draws[: _STARTS - 1])]
    finite = [x for x in inside if np.isfinite(residual(x)).all()]
    found = [_least(residual, slopes, x, bounds) for x in finite]
    return min(found, key=lambda one: one[0], default=(0.0, middle))[1]


def _least(
    residual: Curve, slopes: Curve, start: Array, bounds: tuple[Array, Array]
) -> tuple[float, Array]:
    """Least cost from a start, and where."""
    try:
        found = least_squares(residual, start, slopes, bounds, max_nfev=_CALLS, ftol=_ENOUGH)
    except ValueError:  # a curve that is not finite on the way
        return np.inf, start
    return float(found.cost), np.asarray(found.x)
