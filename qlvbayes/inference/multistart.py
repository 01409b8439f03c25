"""Climbs from several places: relaxation spectra have more than one hump."""

from __future__ import annotations

import numpy as np

from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble, Subset

_STARTS = 6
_FIRST_STEPS = 10
_KEPT = 3  # that are followed to the top
_SAME = 0.4  # of the numbers of the relaxation, within which two places are one hump


def wide_climb(ensemble: Ensemble, subset: Subset, theta: np.ndarray) -> Point:
    """Highest point found from theta and from draws of the plain constants' priors."""
    return wide_climbs(ensemble, subset, theta)[0]


def wide_climbs(ensemble: Ensemble, subset: Subset, theta: np.ndarray) -> list[Point]:
    """Tops of the humps found from theta and from draws of the plain constants' priors, best first.

    The effects' numbers begin where theta has them, the noise at its prior's centre: a model that
    has settled on a wrong spectrum does not leave it when an effect is added.
    """
    plain = ensemble.plain
    thetas = np.tile(theta, (_STARTS, 1))
    thetas[1, plain] = ensemble.centre[plain]
    thetas[2:, plain] = ensemble.draw(_STARTS - 2)[:, plain]
    thetas[:, ensemble.noise] = ensemble.centre[ensemble.noise]
    rough = [climb(ensemble, subset, start, steps=_FIRST_STEPS) for start in thetas]
    tops = [climb(ensemble, subset, point.theta) for point in _humps(ensemble, rough)[:_KEPT]]
    return _humps(ensemble, tops)


def _humps(ensemble: Ensemble, points: list[Point]) -> list[Point]:
    """The highest first, one of those that lie close to each other."""
    found: list[Point] = []
    for point in sorted(points, key=lambda point: point.loss):
        gaps = [np.abs(point.theta - other.theta)[ensemble.plain].max() for other in found]
        if all(gap > _SAME for gap in gaps):
            found.append(point)
    return found
