r"""A rival that no list holds: a spring of free form beside the pad.

.. math:: F = F_{plain} + F_{peak} \sum_{k=1}^J a_k (P_k(x) - P_k(-1)) + F_{peak} h \max(x - x_0, 0)

with Legendre polynomials P_k of the depth x and normal priors of the a_k: J = 8 without the kink,
or J = 3 with it (h normal, x_0 uniform over the depth). It stands for what the list leaves out of
the force over depth (a stiffer core, a second contact). Spring and pad are 0 together while the
specimen is not touched.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.stats import norm

from qlvbayes.diagnosis.freeform import AbstractCurvedForm, polynomials
from qlvbayes.effects.adhesion import Adhesion
from qlvbayes.inference.gaussnewton import Point, predict_along

_SD = 0.03  # of each coefficient
_KINK_SD = 0.2  # of the kink's stiffness, of the peak force over the whole depth
_KINKS = (0.2, 0.4, 0.6, 0.8)  # where the search for it starts
_ENDLESS = 1e6  # adhesion, over the peak force
_ROUNDING = 1e-9
_SHORT = 5  # steps, before all but the best start are given up


@dataclass(frozen=True, eq=False)
class FreeSpring(AbstractCurvedForm):
    """The plain model and a smooth spring; see the module."""

    orders: ClassVar[int] = 8

    @property
    def sds(self) -> np.ndarray:
        """(J,) of the coefficients' priors."""
        return np.full(self.orders, _SD)

    def curves(self, depth: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """(J, ...) polynomials of depth that are 0 at no depth; the clock has no part in it."""
        start = polynomials(np.zeros(1), self.orders).reshape(-1, *[1] * np.ndim(depth))
        return polynomials(depth, self.orders) - start

    def combine(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The plain model's force and the spring's, with the slopes of both."""
        plain, slopes = predict_along(self.ensemble, constants, directions)
        held, held_slopes = self._held(constants, directions, (plain, slopes))
        spring, own = self.spring(coefficients)
        peak = self.experiment.scales.force
        touched = (held > plain - _ROUNDING * peak) | (held + peak * spring > plain)
        force = np.where(touched, held + peak * spring, plain)
        return force, np.concatenate([np.where(touched, held_slopes, slopes), touched * peak * own])

    def _held(
        self,
        constants: np.ndarray,
        directions: np.ndarray,
        loose: tuple[np.ndarray, np.ndarray],
    ) -> tuple[np.ndarray, np.ndarray]:
        """What the plain model gives (force, slopes) if the platen could pull without end."""
        name = f"{Adhesion.name}.strength"
        if name not in self.ensemble.names:
            return loose
        sticky = constants.copy()
        sticky[self.ensemble.names.index(name)] = _ENDLESS * self.experiment.scales.force
        return predict_along(self.ensemble, sticky, directions)

    def spring(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Its force (T, B) over the peak, and slopes (J, T, B) along the coefficients."""
        return np.tensordot(coefficients, self.at_blocks, 1), self.at_blocks


@dataclass(frozen=True, eq=False)
class KinkedSpring(FreeSpring):
    """The plain model and a spring with a kink; the place of which is a normal's quantile."""

    orders: ClassVar[int] = 3

    @property
    def sds(self) -> np.ndarray:
        """(J + 2,) of the coefficients, the kink's stiffness and its place."""
        return np.append(super().sds, (_KINK_SD, 1.0))

    def highest(self, start: Point, worth: float) -> Point:
        """The highest point found from a few places of the kink."""
        bent = [np.append(np.zeros(self.orders + 1), norm.ppf(x)) for x in _KINKS]
        points = [replace(start, theta=np.append(start.theta, own)) for own in bent]
        points = [self.fit(point, steps=_SHORT) for point in points]
        return self.fit(min(points, key=lambda point: point.loss), worth=worth)

    def spring(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Smooth up to the kink."""
        *smooth, stiffness, place = coefficients
        beyond = np.maximum(self.places[0] - norm.cdf(place), 0.0)
        force, slopes = super().spring(np.array(smooth))
        moved = -stiffness * norm.pdf(place) * (beyond > 0.0)
        return force + stiffness * beyond, np.concatenate([slopes, [beyond, moved]])
