"""Give starting points for optimising a hypothesis from a neighbour's mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from qlvbayes.inference.density import Point
from qlvbayes.inference.forward.fixedrates import relaxation_of
from qlvbayes.inference.forward.hypothesis import Hypothesis, Parameters
from qlvbayes.inference.forward.space import FEW, Space
from qlvbayes.inference.projection import projected, with_curve
from qlvbayes.io.arrays import Array
from qlvbayes.priors.natural import Natural

_SHAPES = 4  # quantiles of the prior of an effect's first constant other than its amplitude


class Amplitude(NamedTuple):
    """The parameter with which an effect's force grows."""

    number: int  # its index in theta
    constant: int  # its index in the constants
    sd: float  # of its prior


def amplitude_of(parameters: Parameters, effect: str) -> Amplitude | None:
    """Return the amplitude of an effect; None if no parameter of its is an amplitude."""
    for name, leaf in parameters.by_name.items():
        if name.startswith(f"{effect}.") and isinstance(leaf.prior, Natural):
            return Amplitude(leaf.theta.start, leaf.constants.start, float(leaf.prior.sd))
    return None


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
    count = max(count, space.effects[effect].shapes)
    return over_shapes(
        space, parameters, effect, transferred(point.own, point.theta, parameters), count
    )


def over_shapes(
    space: Space, parameters: Parameters, effect: str, theta: Array, count: int = _SHAPES
) -> list[Array]:
    """Return thetas (G,) that add an effect without force, over its shape's prior."""
    base = theta.copy()
    leaves = [leaf for name, leaf in parameters.by_name.items() if name.startswith(f"{effect}.")]
    draws, taken, shape = space.draws("effects", effect), 0, None
    for leaf in leaves:
        values = draws[:, taken : taken + len(leaf.theta)]
        taken += len(leaf.theta)
        if isinstance(leaf.prior, Natural):
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
    space: Space, point: Point, hypothesis: Hypothesis, count: int, sizes: tuple[float, float]
) -> list[Array]:
    """Return thetas (F,) from which to optimise a hypothesis, given a mode of a neighbour."""
    parameters = space.parameters(hypothesis)
    base = projected(space, point, hypothesis, transferred(point.own, point.theta, parameters))
    thetas = [base]
    for effect in sorted(hypothesis.effects - point.own.hypothesis.effects):
        thetas = [
            theta
            for start in thetas
            for theta in _small_and_large(space, point, parameters, effect, start, count, sizes)
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


def _small_and_large(
    space: Space,
    point: Point,
    parameters: Parameters,
    effect: str,
    theta: Array,
    count: int,
    sizes: tuple[float, float],
) -> list[Array]:
    """Return thetas (F,) with an effect at each size, all shapes at one size after another."""
    many = space.effects[effect].shapes
    shapes_at_zero = over_shapes(space, parameters, effect, theta, max(count, many))
    amplitude = amplitude_of(parameters, effect)
    if amplitude is None:
        return shapes_at_zero
    if len(shapes_at_zero) > count:
        gains = _gains(space, point, parameters, amplitude, shapes_at_zero)
        shapes_at_zero = [shapes_at_zero[k] for k in np.argsort(-gains)[:count]]
    signed = parameters.lowest[amplitude.number] == -np.inf
    thetas = []
    for size in (*sizes, -sizes[1]) if signed else sizes:
        for at_zero in shapes_at_zero:
            start = at_zero.copy()
            start[amplitude.number] += size * amplitude.sd
            thetas.append(start)
    return thetas


def _gains(
    space: Space, point: Point, parameters: Parameters, amplitude: Amplitude, some: Sequence[Array]
) -> Array:
    """Return by how much an effect at each shape lowers the sum of squares (N2) at a point."""
    thetas = np.stack(some)
    thetas[:, amplitude.number] += amplitude.sd
    none = parameters.constants(np.stack(some))
    hypothesis, real = parameters.hypothesis, space.real
    forces = space.forces(hypothesis, parameters.constants(thetas))
    added = (forces - space.forces(hypothesis, none))[:, real]
    left = (np.asarray(space.record.blocks.force) - point.predicted)[real]
    basis, _ = np.linalg.qr(point.responses[:, real].T)
    own = added - (added @ basis) @ basis.T
    toward, size = np.maximum(own @ left, 0.0), np.sum(own**2, axis=1)
    return toward**2 / np.maximum(size, np.finfo(float).tiny)
