"""Slices through a posterior: a constant of an effect held, all others at their mode.

Where the amplitude may be zero the posterior has an arm along the whole prior of each constant
beside it, such as a rate; where that is a rate of the pad, one along the amplitude.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.density import Density
from qlvbayes.inference.engine import filled_up
from qlvbayes.inference.importance import Cloud
from qlvbayes.inference.modes import Mode, find_mode
from qlvbayes.inference.space import Leaf, Parameters
from qlvbayes.model.posterior import is_prior

Array = NDArray[np.float64]

_ACROSS = (0.125, 0.375, 0.625, 0.875)  # quantiles of a constant's prior draws
_BETWEEN = 0.5  # of their sd: about half of what lies between two of these


@dataclass(frozen=True, eq=False)
class Slice:
    """Loss at the mode, and a cloud about it that reaches to the next slices."""

    loss: float
    cloud: Cloud


def slices(density: Density, own: Parameters, effect: str, best: Mode) -> Iterator[Slice]:
    """At quantiles of each constant of the effect, from the best mode's other numbers."""
    draws = density.space.plain_draws(own.hypothesis)
    fields = {
        name.removeprefix(f"{effect}.").partition("[")[0]: leaf
        for name, leaf in own.by_name.items()
        if name.startswith(f"{effect}.")
    }
    middle = best.point.theta.copy()
    for leaf in fields.values():
        middle[list(leaf.theta)] = np.median(draws[:, list(leaf.theta)], axis=0)
    for field, leaf in fields.items():
        places = list(leaf.theta)
        sds = _BETWEEN * draws[:, places].std(axis=0)
        for share in _ACROSS:
            start = middle.copy()
            start[places] = np.quantile(draws[:, places], share, axis=0)
            held = _held(density, effect, field, leaf, start)
            kept = own.carried(held.space.parameters(own.hypothesis))
            mode = find_mode(held, own.hypothesis, start[kept])
            if mode is not None:
                start[kept] = mode.point.theta
                covariance = _along(density, own, start, places, sds)
                yield Slice(mode.loss, Cloud.of(start, covariance))


def _held(density: Density, effect: str, field: str, leaf: Leaf, theta: Array) -> Density:
    """The density with one field of an effect fixed at its value at theta (F,)."""
    space = density.space
    value = leaf.values(filled_up(theta[None]))[0]
    fixed = eqx.tree_at(lambda e: getattr(e, field), space.effects[effect], value, is_leaf=is_prior)
    return density.with_space(space.with_effects({**space.effects, effect: fixed}))


def _along(density: Density, own: Parameters, theta: Array, held: list[int], sds: Array) -> Array:
    """Covariance (F, F) of what is free beside numbers of sds (H,), and follows them on its way."""
    point = density.at(own.hypothesis, theta)
    assert point is not None  # it was finite in the slice
    between = np.isfinite(own.lowest) & np.isfinite(own.highest)
    curvature = density.terms(point, 0.0).curvature + np.diag(between / own.length**2)
    free = np.setdiff1d(np.arange(own.size), held)
    beside = np.linalg.inv(curvature[np.ix_(free, free)])
    way = np.eye(own.size)[:, held]
    way[free] = -beside @ curvature[free][:, held]
    covariance = np.asarray((way * sds**2) @ way.T)
    covariance[np.ix_(free, free)] += beside
    return covariance
