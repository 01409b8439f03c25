"""Fit the constants of one law to the curve of another law, without any force.

An elastic law is compared by its force over depth, a relaxation by its function over the logarithm
of time. Where one law replaces another, optimisation starts from the nearest of its curves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import Space
from qlvbayes.io.arrays import Array

Curve = Callable[[Array], Array]

_CLOSE = 0.01  # of the curve's largest value: a deviation that costs as much as one prior sd
_STARTS = 2  # draws of the priors, the median first
_CALLS = 15  # evaluations of the curve at most: the force decides what follows
_TOLERANCE = 1e-3  # relative decrease of the cost in a step at which a fit ends
_STEP = 1e-6  # of difference quotients


def projected(space: Space, point: Point, hypothesis: Hypothesis, theta: Array) -> Array:
    """Return theta (F,) with parameters of its laws whose curves are nearest to the point's."""
    projected_theta = theta
    for part in ("elastic", "relaxation"):
        if getattr(hypothesis, part) == getattr(point.own.hypothesis, part):
            continue
        goal = space.curve(point.own.hypothesis, part, point.constants[None])[0]
        projected_theta = with_curve(space, hypothesis, part, goal, projected_theta)
    return projected_theta


def with_curve(space: Space, hypothesis: Hypothesis, part: str, goal: Array, theta: Array) -> Array:
    """Return theta (F,) with the parameters of one law fitted so that its curve is near a goal."""
    indices = space.indices_of(hypothesis, part)
    if not indices:
        return theta
    parameters, fitted = space.parameters(hypothesis), theta.copy()
    curve = _curve(space, parameters, part, theta, indices)
    fitted[indices] = _fitted(curve, goal, space.draws_of(hypothesis, part), parameters, indices)
    return fitted


def _curve(
    space: Space, parameters: Parameters, part: str, theta: Array, indices: list[int]
) -> Callable[[Array], Array]:
    """Return a function from values (K, count) of some of theta's parameters to curves (K, 40)."""

    def curve(values: Array) -> Array:
        thetas = np.tile(theta, (len(values), 1))
        thetas[:, indices] = values
        return space.curve(parameters.hypothesis, part, parameters.constants(thetas))

    return curve


def _fitted(
    curve: Curve, goal: Array, draws: Array, parameters: Parameters, indices: list[int]
) -> Array:
    """Return parameters (count,) whose curve is nearest to a goal, held near the priors' draws."""
    middle, spread = np.median(draws, axis=0), np.maximum(draws.std(axis=0), _STEP)
    scale = _CLOSE * float(np.max(np.abs(goal)))
    steps = _STEP * np.eye(middle.size)

    def residual(x: Array) -> Array:
        return np.concatenate([(curve(x[None])[0] - goal) / scale, (x - middle) / spread])

    def slopes(x: Array) -> Array:
        rows = curve(np.concatenate([x[None], x + steps]))
        return np.concatenate([(rows[1:] - rows[0]).T / (_STEP * scale), np.diag(1.0 / spread)])

    bounds = parameters.lowest[indices], parameters.highest[indices]
    inside = [np.clip(x, *bounds) for x in (middle, *draws[: _STARTS - 1])]
    finite = [x for x in inside if np.isfinite(residual(x)).all()]
    fits = [_least(residual, slopes, x, bounds) for x in finite]
    return min(fits, key=lambda one: one[0], default=(0.0, middle))[1]


def _least(
    residual: Curve, slopes: Curve, start: Array, bounds: tuple[Array, Array]
) -> tuple[float, Array]:
    """Return the least cost that a start leads to, and the parameters there."""
    try:
        fit = least_squares(residual, start, slopes, bounds, max_nfev=_CALLS, ftol=_TOLERANCE)
    except ValueError:  # the curve became infinite
        return np.inf, start
    return float(fit.cost), np.asarray(fit.x)
