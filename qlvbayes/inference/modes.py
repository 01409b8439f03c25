"""Modes of a hypothesis: damped Gauss-Newton steps within bounds, from one start or from many."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.inference.density import Density, Point, Terms
from qlvbayes.inference.subset import Subset

Array = NDArray[np.float64]

_STEPS = 60
_ENOUGH = 5e-3  # rise of the log density that a step promises, below which the mode is found
_FARTHEST = 3.0  # longest step in a natural length
_DAMPING = (1e-3, 1e-4, 1e9)  # first, least, most
_SAME = 0.5  # of loss, within which two modes are one


@dataclass(frozen=True, eq=False)
class Mode:
    """Where optimising ended: the point, the discrepancy's size (N) there, the loss.

    converged: whether no step promised more; steps: how many were tried.
    """

    point: Point
    size: float
    loss: float
    converged: bool
    steps: int


def find_mode(density: Density, subset: Subset, start: Array, steps: int = _STEPS) -> Mode | None:
    """Levenberg-Marquardt from theta (D,); the discrepancy's size follows. None: not finite."""
    point = density.at(subset, start)
    if point is None:
        return None
    lowest, length = density.bounds(subset)
    size = density.likeliest_size(point)
    here = density.terms(point, size)
    damping, least, most = _DAMPING
    tried = 0
    for tried in range(1, steps + 1):
        own = point.theta[subset.theta]
        step = _step(here, damping, lowest - own, length)
        promise = -float(here.gradient @ step + 0.5 * step @ here.curvature @ step)
        if promise < _ENOUGH and damping <= 1.0:
            return Mode(point, size, here.loss, True, tried)
        moved = point.theta.copy()
        moved[subset.theta] = np.maximum(own + step, lowest)
        found = density.at(subset, moved)
        after = density.terms(found, size) if found is not None else None
        if found is None or after is None or not after.loss < here.loss:
            damping *= 10.0
            if damping > most:
                return Mode(point, size, here.loss, True, tried)
            continue
        gain = (here.loss - after.loss) / max(promise, 1e-300)
        damping = max(damping * (0.1 if gain > 0.5 else 1.0 if gain > 0.1 else 4.0), least)
        point = found
        likeliest = density.likeliest_size(point)
        here = after if likeliest == size else density.terms(point, likeliest)
        size = likeliest
    return Mode(point, size, here.loss, False, tried)


def modes(density: Density, subset: Subset, starts: Iterable[Array]) -> list[Mode]:
    """Distinct modes from many starts, the highest first."""
    found = [find_mode(density, subset, start) for start in starts]
    kept: list[Mode] = []
    for mode in sorted((m for m in found if m is not None), key=lambda m: m.loss):
        if not any(_alike(mode, other) for other in kept):
            kept.append(mode)
    return kept


def _alike(one: Mode, two: Mode) -> bool:
    """Whether two are one: of equal height and hardly apart by the curvature."""
    if abs(one.loss - two.loss) > _SAME:
        return False
    gap = (one.point.theta - two.point.theta)[one.point.subset.theta]
    curvature = one.point.jacobian @ one.point.jacobian.T + one.point.prior.curvature
    return bool(gap @ curvature @ gap < 1e3 or np.allclose(gap, 0.0, atol=1e-3))


def _step(terms: Terms, damping: float, room: Array, length: Array) -> Array:
    """A damped step (F,) within what room (F,) the bounds leave."""
    step = np.zeros(terms.gradient.size)
    free = ~((room >= 0.0) & (terms.gradient > 0.0))
    if not free.any():
        return step
    gradient, curvature = terms.gradient[free], terms.curvature[np.ix_(free, free)]
    diagonal = np.maximum(np.diag(curvature), 1e-8 * np.diag(terms.curvature).max())
    scale = 1.0 / np.sqrt(diagonal)
    matrix = curvature * np.outer(scale, scale) + (damping + 1e-13) * np.eye(scale.size)
    step[free] = -scale * np.linalg.solve(matrix, gradient * scale)
    step *= min(1.0, _FARTHEST / max(float(np.max(np.abs(step) / length)), 1e-300))
    return np.maximum(step, room)
