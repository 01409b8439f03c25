"""The tops of a posterior with one effect, as climbs from several shapes find them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble, Place, Subset

_LARGE = 1.0  # quantile of the amplitude's prior draws: the largest
_ACROSS = (0.125, 0.375, 0.625, 0.875)  # and of each shape's
_WORTH = 8.0  # in log density behind the best
_SAME = 1.0  # posterior sd within which two tops are one


@dataclass(frozen=True, eq=False)
class Slice:
    """Top (Point, over all numbers but a shape's) with the shape held, and those (F,) held."""

    top: Point
    held: np.ndarray


def tops(ensemble: Ensemble, subset: Subset, effect: str) -> tuple[list[Point], list[Slice]]:
    """Tops that matter, highest first, and slices through the posterior that do.

    From too small an amplitude the way up may be barred, as where a pad lets go before it pulls. A
    shape is a constant besides the amplitude, such as a rate: the likelihood has a hump for each
    rate of the pad with which it may be confused, and where the amplitude may be zero the posterior
    has an arm along the whole of the shape's prior.
    """
    amplitude, *shapes = _fields(ensemble, effect)
    large = _moved(ensemble.centre, amplitude, ensemble.quantile(amplitude, _LARGE))
    found = [climb(ensemble, subset, theta) for theta in (ensemble.centre, large)]
    best = min(found, key=lambda point: point.loss).theta
    for field in (amplitude, *shapes):
        best = _moved(best, field, ensemble.centre[list(field.theta)])
    slices = []
    for shape in shapes:
        held = np.isin(subset.theta, shape.theta)
        sliced = replace(subset, theta=subset.theta[~held])
        for share in _ACROSS:
            start = _moved(best, shape, ensemble.quantile(shape, share))
            slices.append(Slice(climb(ensemble, sliced, start), held))
            found.append(climb(ensemble, subset, slices[-1].top.theta))
    kept = _distinct(found)
    return kept, [s for s in slices if s.top.loss < kept[0].loss + _WORTH]


def _fields(ensemble: Ensemble, effect: str) -> list[Place]:
    """Free fields of the effect, its amplitude first."""
    amplitude = ensemble.amplitude(effect)
    free = [field for field in ensemble.fields(effect) if field.theta]
    return sorted(free, key=lambda field: field.constants.start != amplitude)


def _moved(theta: np.ndarray, field: Place, numbers: np.ndarray) -> np.ndarray:
    """Theta (D,) with other numbers in one field."""
    found = theta.copy()
    found[list(field.theta)] = numbers
    return found


def _distinct(points: list[Point]) -> list[Point]:
    """One of those that lie close to each other, unless too far below the highest."""
    found: list[Point] = []
    for point in sorted(points, key=lambda point: point.loss):
        if not np.isfinite(point.log_evidence):  # on a plateau
            continue
        if found and point.loss > found[0].loss + _WORTH:
            break
        if all(_apart(point, other) for other in found):
            found.append(point)
    return found


def _apart(point: Point, other: Point) -> bool:
    sds = np.sqrt(np.diag(other.covariance))
    return bool(np.max(np.abs(point.theta - other.theta)[point.subset.theta] / sds) > _SAME)
