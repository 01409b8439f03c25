"""Climbs from several places: relaxation spectra have more than one hump."""

from __future__ import annotations

import math

import numpy as np

from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble, Subset
from qlvbayes.inference.together import together

_STARTS = 6
_ANEW = 20
_FIRST_STEPS = 10
_KEPT = 3  # that are followed to the top
_SAME = 0.4  # of the numbers of the relaxation, within which two places are one hump


def wide_climb(
    ensemble: Ensemble, subset: Subset, theta: np.ndarray, worth: float = -math.inf
) -> Point:
    """Highest point found from theta and from draws of the plain constants' priors."""
    return wide_climbs(ensemble, subset, theta, worth)[0]


def wide_climbs(
    ensemble: Ensemble, subset: Subset, theta: np.ndarray, worth: float = -math.inf
) -> list[Point]:
    """Tops of the humps found from theta and from draws of the plain constants' priors, best first.

    The effects' numbers begin where theta has them, the noise at its prior's centre: a model that
    has settled on a wrong spectrum does not leave it when an effect is added. Climbs that do not
    promise to reach the log evidence ``worth`` are given up on their way.
    """
    plain = ensemble.plain
    places = np.stack([theta, ensemble.centre, *ensemble.draw(_STARTS - 2)])[:, plain]
    if np.array_equal(places[0], places[1]):
        places = places[1:]
    thetas = np.tile(theta, (len(places), 1))
    thetas[:, plain] = places
    return _tops(ensemble, subset, thetas, worth)


def climbs_anew(ensemble: Ensemble, subset: Subset) -> list[Point]:
    """Tops of the humps found from draws of all priors, the effects' too, best first.

    Where a mode of the pad and an effect may take each other's place, the way from one to the other
    leads through neither. None is given up: from so far the first steps promise little.
    """
    return _tops(ensemble, subset, ensemble.draw(_ANEW).copy(), -math.inf)


def _tops(ensemble: Ensemble, subset: Subset, thetas: np.ndarray, worth: float) -> list[Point]:
    """Tops of the humps found from thetas (N, D), the noise beginning at its prior's centre."""
    thetas[:, ensemble.noise] = ensemble.centre[ensemble.noise]

    def rise(start: np.ndarray) -> Point:
        return climb(ensemble, subset, start, steps=_FIRST_STEPS, worth=worth)

    def finish(point: Point) -> Point:
        return climb(ensemble, subset, point.theta, worth=worth)

    rough = [point for point in together(rise, thetas) if np.isfinite(point.loss)]
    return _humps(ensemble, together(finish, _humps(ensemble, rough)[:_KEPT]))


def _humps(ensemble: Ensemble, points: list[Point]) -> list[Point]:
    """The highest first, one of those that lie close to each other."""
    found: list[Point] = []
    for point in sorted(points, key=lambda point: point.loss):
        gaps = [np.abs(point.theta - other.theta)[ensemble.plain].max() for other in found]
        if all(gap > _SAME for gap in gaps):
            found.append(point)
    return found
