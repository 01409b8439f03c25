"""The tops of a posterior with one effect, as climbs from several shapes find them."""

from __future__ import annotations

import numpy as np

from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble, Place, Subset

_LARGE = 1.0  # quantile of the amplitude's prior draws: the largest
_ACROSS = (0.125, 0.375, 0.625, 0.875)  # and of each shape's
_WORTH = 8.0  # in log density behind the best
_SAME = 1.0  # posterior sd within which two tops are one


def tops(ensemble: Ensemble, subset: Subset, effect: str) -> list[Point]:
    """Tops that matter, highest first, climbed to from two amplitudes and from other shapes.

    From too small an amplitude the way up may be barred, as where a pad lets go before it pulls. A
    shape is a constant besides the amplitude, such as a rate: the likelihood has a hump for each
    rate of the pad with which it may be confused. There the climbs begin with the plain constants
    already found.
    """
    amplitude, *shapes = _fields(ensemble, effect)
    large = _moved(ensemble.centre, amplitude, ensemble.quantile(amplitude, _LARGE))
    found = [climb(ensemble, subset, theta) for theta in (ensemble.centre, large)]
    best = min(found, key=lambda point: point.loss).theta
    for field in (amplitude, *shapes):
        best = _moved(best, field, ensemble.centre[list(field.theta)])
    for shape in shapes:
        for share in _ACROSS:
            theta = _moved(best, shape, ensemble.quantile(shape, share))
            found.append(climb(ensemble, subset, theta))
    return _distinct(found)


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
