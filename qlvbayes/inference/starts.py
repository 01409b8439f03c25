"""Give starting points for optimising a hypothesis from a neighbour's mode.

Where one law replaces another, optimisation starts from the nearest of its curves. An elastic law
is compared by its force over depth, a relaxation by its function over the logarithm of time, and
the constants are fitted to the curve without any force of the record.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from scipy.optimize import least_squares

from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.fixedrates import relaxation_of
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import FEW, Space
from qlvbayes.io.arrays import Array

_SCALED = 0.1  # least share of an amplitude to which a start is scaled down
_SHAPES = 4  # quantiles of the prior of an effect's first constant other than its amplitude
_CLOSE = 0.01  # of a curve's largest value: a deviation that costs as much as one prior sd
_STARTS = 2  # draws of the priors, the median first
_CALLS = 15  # evaluations of a curve at most: the force decides what follows
_TOLERANCE = 1e-3  # relative decrease of the cost in a step at which a fit ends
_STEP = 1e-6  # of difference quotients


def transferred(
    old: Parameters, theta: Array, new: Parameters, others: Array | None = None
) -> Array:
    """Return theta (G,) of other parameters, with values of those that both have copied over."""
    target = np.zeros(new.size) if others is None else others.copy()
    leaves = old.by_name
    for name, leaf in new.by_name.items():
        if name in leaves and len(leaves[name].theta) == len(leaf.theta):
            target[list(leaf.theta)] = theta[list(leaves[name].theta)]
    return target


def without(space: Space, point: Point, effect: str) -> tuple[Hypothesis, Array]:
    """Return a point's hypothesis without one of its effects, and its constants (1, P) there."""
    less = point.own.hypothesis.less(effect)
    parameters = space.parameters(less)
    theta = transferred(point.own, point.theta, parameters)
    return less, parameters.constants(theta[None])


def shapes(
    space: Space, point: Point, parameters: Parameters, effect: str, count: int = _SHAPES
) -> list[Array]:
    """Return thetas (G,) that add an effect without force to a point, over its shape's prior."""
    theta = transferred(point.own, point.theta, parameters)
    return over_shapes(space, parameters, effect, theta, count)


def over_shapes(
    space: Space, parameters: Parameters, effect: str, theta: Array, count: int = _SHAPES
) -> list[Array]:
    """Return thetas (G,), ``count`` or more, that add an effect without force over its shapes."""
    base, count = theta.copy(), max(count, space.effects[effect].shapes)
    leaves = [leaf for name, leaf in parameters.by_name.items() if name.startswith(f"{effect}.")]
    draws, shape = space.prior_draws(parameters.hypothesis), None
    for leaf in leaves:
        values = draws[:, leaf.theta]
        if leaf.theta.start in parameters.amplitudes:
            base[leaf.theta.start] = next(iter(space.effects[effect].null.values()))
            continue
        base[list(leaf.theta)] = np.median(values, axis=0)
        shape = shape or (leaf, values)
    if shape is None:
        return [base]
    leaf, values = shape
    thetas = []
    for share in (np.arange(count) + 0.5) / count:
        start = base.copy()
        start[list(leaf.theta)] = np.quantile(values, share, axis=0)
        thetas.append(start)
    return thetas


def starts(
    space: Space,
    point: Point,
    hypothesis: Hypothesis,
    count: int,
    sizes: tuple[float, float],
    optimised: int,
) -> list[Array]:
    """Return thetas (F,) from which to optimise a hypothesis, given a mode of a neighbour.

    A new effect's force is tried at ``count`` or more shapes and at each of ``sizes`` (sds of the
    amplitude's prior); ``optimised`` of them are starts.
    """
    parameters = space.parameters(hypothesis)
    base = projected(space, point, hypothesis, transferred(point.own, point.theta, parameters))
    thetas = [base]
    for effect in sorted(hypothesis.effects - point.own.hypothesis.effects):
        thetas = [
            theta
            for start in thetas
            for theta in _screened(space, point, parameters, effect, start, count, sizes, optimised)
        ]
    return thetas


def exchanged_starts(space: Space, point: Point, hypothesis: Hypothesis) -> list[Array]:
    """Return thetas (F,) of a hypothesis without an effect that a mode has on the relaxation."""
    fuller, starts_without = point.own.hypothesis, []
    if all(fuller.less(name) != hypothesis for name in space.relaxing & fuller.effects):
        return []
    fractions, rates = space.spectra(fuller, point.constants[None])
    if rates.shape[1] > FEW + 1:
        return []
    theta = transferred(point.own, point.theta, space.parameters(hypothesis))
    for k in range(rates.shape[1]):
        rest = np.delete(fractions, k + 1, axis=1)
        rest /= rest.sum(axis=1, keepdims=True)
        goal = relaxation_of(rest, np.delete(rates, k, axis=1), space.curve_grids[1])[0]
        starts_without.append(with_curve(space, hypothesis, "relaxation", goal, theta))
    return starts_without


def _screened(
    space: Space,
    point: Point,
    parameters: Parameters,
    effect: str,
    theta: Array,
    count: int,
    sizes: tuple[float, float],
    optimised: int,
) -> list[Array]:
    """Return thetas (F,) with an effect at the shape and amplitude that promise most at a point.

    The effect's force at each shape and at each of ``sizes`` (sds of the amplitude's prior) is
    projected on what the constants at the point cannot follow. It gains what it takes of the sum of
    squares (N2). The one of each size that gains most starts, scaled to where it gains most.
    """
    at_zero = np.stack(over_shapes(space, parameters, effect, theta, count))
    amplitude = parameters.amplitude_of.get(effect)
    if amplitude is None:
        return list(at_zero)
    real = space.real
    left = (np.asarray(space.record.blocks.force) - point.predicted)[real]
    basis, _ = np.linalg.qr(point.responses[:, real].T)
    signed = parameters.lowest[amplitude.number] == -np.inf
    chosen = []
    for size in (*sizes, *(-one for one in sizes)) if signed else sizes:
        step = size * amplitude.sd
        added = space.added_forces(parameters.hypothesis, at_zero, amplitude.number, step)[:, real]
        added = np.where(np.isfinite(added).all(axis=1, keepdims=True), added, 0.0)
        own = added - (added @ basis) @ basis.T
        toward = np.maximum(own @ left, 0.0)
        squares = np.maximum(np.sum(own**2, axis=1), np.finfo(float).tiny)
        gains = toward**2 / squares
        k = int(np.argmax(gains))
        start = at_zero[k].copy()
        start[amplitude.number] += np.clip(toward[k] / squares[k], _SCALED, 1.0 / _SCALED) * step
        chosen.append((float(gains[k]), start))
    chosen.sort(key=lambda one: -one[0])
    return [start for _, start in chosen[:optimised]]


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
    """Return theta (F,) with the parameters of one law fitted so that its curve is near a goal.

    They are held near the draws of their priors.
    """
    indices = space.indices_of(hypothesis, part)
    if not indices:
        return theta
    parameters, draws = space.parameters(hypothesis), space.prior_draws(hypothesis)[:, indices]
    middle, spread = np.median(draws, axis=0), np.maximum(draws.std(axis=0), _STEP)
    scale, steps = _CLOSE * float(np.max(np.abs(goal))), _STEP * np.eye(middle.size)

    def curves(values: Array) -> Array:
        thetas = np.tile(theta, (len(values), 1))
        thetas[:, indices] = values
        return space.curve(hypothesis, part, parameters.constants(thetas))

    def residual(x: Array) -> Array:
        return np.concatenate([(curves(x[None])[0] - goal) / scale, (x - middle) / spread])

    def slopes(x: Array) -> Array:
        rows = curves(np.concatenate([x[None], x + steps]))
        return np.concatenate([(rows[1:] - rows[0]).T / (_STEP * scale), np.diag(1.0 / spread)])

    bounds = parameters.lowest[indices], parameters.highest[indices]
    least, nearest = np.inf, middle
    for start in (middle, *draws[: _STARTS - 1]):
        inside = np.clip(start, *bounds)
        with suppress(ValueError):  # the curve is infinite there, or became so
            fit = least_squares(residual, inside, slopes, bounds, max_nfev=_CALLS, ftol=_TOLERANCE)
            if fit.cost < least:
                least, nearest = float(fit.cost), fit.x
    fitted = theta.copy()
    fitted[indices] = nearest
    return fitted
