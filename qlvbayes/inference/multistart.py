"""Climbs from several places: relaxation spectra have more than one hump."""

from __future__ import annotations

import numpy as np

from qlvbayes.inference.gaussnewton import Point, climb
from qlvbayes.inference.subset import Ensemble, Subset

_STARTS = 6
_LEGS = ((5, 3), (5, 2))  # steps of a leg, and how many of the best go on from it
_SAME = 0.05  # log density within which two climbs have come to one place


def wide_climb(ensemble: Ensemble, subset: Subset, theta: np.ndarray) -> Point:
    """Highest point found from theta and from draws of the plain constants' priors.

    The effects' numbers begin where theta has them, the noise at its prior's centre: a model that
    has settled on a wrong spectrum does not leave it when an effect is added.
    """
    plain = ensemble.plain
    thetas = np.tile(theta, (_STARTS, 1))
    thetas[1, plain] = ensemble.centre[plain]
    thetas[2:, plain] = ensemble.draw(_STARTS - 2)[:, plain]
    thetas[:, ensemble.noise] = ensemble.centre[ensemble.noise]
    places = list(thetas)
    for steps, kept in _LEGS:
        points = [climb(ensemble, subset, place, steps=steps) for place in places]
        places = [point.theta for point in _distinct(points)[:kept]]
    return min((climb(ensemble, subset, place) for place in places), key=lambda point: point.loss)


def _distinct(points: list[Point]) -> list[Point]:
    """The highest first, each place once."""
    found: list[Point] = []
    for point in sorted(points, key=lambda point: point.loss):
        if not found or point.loss - found[-1].loss > _SAME:
            found.append(point)
    return found
