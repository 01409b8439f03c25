r"""A channel that records late not by one delay but by many: an average over the past.

.. math:: F = \sum_k w_k F_k, \quad F_k: \text{ the force late by } \mathrm{delay} (1 + a (s_k - 1))

with the nodes s_k and weights w_k of Gauss-Laguerre quadrature. a = 0: the list's law; a = 1: a lag
of first order, as of an analogue filter, whose time is the delay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import roots_laguerre

from qlvbayes.diagnosis.forms.otherform import AbstractOtherForm, Shape, pairs
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.inference.gaussnewton import Point, predict_along

_NODES, _WEIGHTS = roots_laguerre(5)
_SD = 1.0
_MOST = 1.5  # beyond, some delays would be none and others very long


@dataclass(frozen=True, eq=False)
class SpreadLag(AbstractOtherForm):
    """A channel lag with its delay spread by a; see the module."""

    @property
    def sds(self) -> np.ndarray:
        """(1,) of the prior of a."""
        return np.array([_SD])

    def combine(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The average over the delays."""
        place = self._place
        still = np.zeros((1, constants.size))
        force, slopes = np.zeros(()), np.zeros(())
        for weight, factor, slope in zip(_WEIGHTS, *_factors(coefficients[0]), strict=True):
            at, along = constants.copy(), np.concatenate([directions, still])
            at[place] *= factor
            along[:, place] *= factor
            along[-1, place] = constants[place] * slope
            one, own = predict_along(self.ensemble, at, along)
            force, slopes = force + weight * one, slopes + weight * own
        return force, slopes

    def predict(
        self, samples: Samples, constants: np.ndarray, coefficients: np.ndarray
    ) -> list[list[np.ndarray]]:
        """The average over the delays."""
        found = []
        for own, a in zip(constants, coefficients[:, 0], strict=True):
            at = np.tile(own, (_NODES.size, 1))
            at[:, self._place] *= _factors(a)[0]
            trials = zip(*samples.predict(at), strict=True)
            found.append([_WEIGHTS @ np.stack(forces) for forces in trials])
        return found

    def highest(self, start: Point, worth: float) -> Point:
        """From a lag of first order."""
        return self.fit(replace(start, theta=np.append(start.theta, 1.0)), worth=worth)

    def least(self, point: Point) -> float:
        """0 or more: what is recorded is never turned round."""
        factors, _ = _factors(point.theta[-1])
        return float(factors.min() / factors.max())

    def is_typical(self, point: Point) -> bool:
        """From one delay to a lag of first order, and a little more."""
        return bool(0.0 < point.theta[-1] < _MOST)

    def shape(self, point: Point) -> Shape:
        """Each delay (s) with its weight."""
        factors, _ = _factors(point.theta[-1])
        return Shape(
            self.effect, over_delay=pairs(point.constants[self._place] * factors, _WEIGHTS)
        )

    @property
    def _place(self) -> int:
        """Of the delay among the constants."""
        return self.ensemble.names.index(f"{self.effect}.delay")


def _factors(a: float) -> tuple[np.ndarray, np.ndarray]:
    """(5,) what the delay is multiplied by, never below 0, and its slopes along a."""
    factors = 1.0 + a * (_NODES - 1.0)
    return np.maximum(factors, 0.0), np.where(factors > 0.0, _NODES - 1.0, 0.0)
