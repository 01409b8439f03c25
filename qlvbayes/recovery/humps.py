"""The tops of a posterior with one effect, as climbs from several shapes find them."""

from __future__ import annotations

import numpy as np

from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble, Subset

_ACROSS = (0.125, 0.375, 0.625, 0.875)  # quantiles of each shape's prior
_LARGE = 0.9  # of the amplitude's
_FIRST_STEPS = 8
_HOPE = 50.0  # in log density behind the best, on the way up
_WORTH = 8.0  # at the top
_SAME = 1.0  # posterior sd within which two tops are one


def starts(ensemble: Ensemble, effect: str) -> list[np.ndarray]:
    """Places (D,) to climb from: the priors' centre, a large amplitude, each shape's whole prior.

    A shape is a constant besides the amplitude, such as a rate: the likelihood has a hump for each
    rate of the pad with which it may be confused. From too small an amplitude the way up may be
    barred, as where a pad lets go before it pulls.
    """
    found = [ensemble.centre]
    amplitude = ensemble.amplitude(effect)
    for place in ensemble.fields(effect):
        if not place.theta:
            continue
        for share in [_LARGE] if place.constants.start == amplitude else _ACROSS:
            theta = ensemble.centre.copy()
            theta[list(place.theta)] = ensemble.quantile(place, share)
            found.append(theta)
    return found


def tops(ensemble: Ensemble, subset: Subset, places: list[np.ndarray]) -> list[Point]:
    """Tops that matter, highest first, climbed to from these places."""
    rough = [climb(ensemble, subset, place, steps=_FIRST_STEPS) for place in places]
    found = [climb(ensemble, subset, point.theta) for point in _distinct(rough, _HOPE)]
    return _distinct(found, _WORTH)


def _distinct(points: list[Point], behind: float) -> list[Point]:
    """One of those that lie close to each other, unless too far below the highest."""
    found: list[Point] = []
    for point in sorted(points, key=lambda point: point.loss):
        if not np.isfinite(point.log_evidence):  # on a plateau
            continue
        if found and point.loss > found[0].loss + behind:
            break
        if all(_apart(point, other) for other in found):
            found.append(point)
    return found


def _apart(point: Point, other: Point) -> bool:
    sds = np.sqrt(np.diag(other.covariance))
    return bool(np.max(np.abs(point.theta - other.theta)[point.subset.theta] / sds) > _SAME)
