r"""An effect in a form other than the list's law: what it adds, times a smooth factor.

.. math:: F = F_0 + (F_1 - F_0) \Big(1 + \sum_{k=1}^3 a_k P_k(x) + \sum_{k=1}^3 b_k P_k(y)\Big)

F_1, F_0: the force with the effect and without it; P_k: Legendre polynomials; x, y: depth and the
pad's clock, each over its range in the study. The factor is 1 where all a and b are 0. A drag that
grows with depth or a drift that levels off is then still a drag or a drift.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from qlvbayes.diagnosis.freeform import AbstractCurvedForm, AbstractFreeForm, polynomials
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.experiment import Trial
from qlvbayes.inference.gaussnewton import Point, predict_along

_ORDERS = 3
_STARTS = 12
_HEATS = ((4, 4), (8, 2))  # steps of a climb, and how many climbs go on
SD = 0.7  # of the first coefficient's prior; the k-th has one k-th of it


@dataclass(frozen=True)
class Shape:
    """What an effect is multiplied by.

    over_depth: (depth in mm, factor) at mid-clock; over_clock: (clock in s, factor) at mid-depth;
    over_force: (force beneath in N, factor); over_pressure: (pressure in N, factor of the rate at
    which it drains); over_delay: (delay in s, weight). Empty where the form knows no such change.
    """

    effect: str
    over_depth: tuple[tuple[float, float], ...] = ()
    over_clock: tuple[tuple[float, float], ...] = ()
    over_force: tuple[tuple[float, float], ...] = ()
    over_pressure: tuple[tuple[float, float], ...] = ()
    over_delay: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class AbstractOtherForm(AbstractFreeForm):
    """One effect of a model, in another form.

    replaces: whether the subset does without the effect, whose law the form takes the place of;
    distant: whether the list's law may be far from it, so that the form is tried whatever stands
    before it in the ranking, and climbed to from anywhere;
    clocked: whether it changes with the pad's clock, so that other tests do not tell it in one.
    """

    effect: str
    replaces: ClassVar[bool] = False
    distant: ClassVar[bool] = False
    clocked: ClassVar[bool] = False

    def highest(self, start: Point, worth: float) -> Point:
        """The highest point found from the optimum of the list's law, given up as in ``fit``.

        Of a distant form also from draws of the effect's priors: where the list's law is at its
        best, the form may have another hump or none.
        """
        if not self.distant:
            return super().highest(start, worth)
        points = self._starts(start)
        for steps, kept in _HEATS:
            points = [self.fit(point, steps=steps, worth=worth) for point in points]
            points = [point for point in points if np.isfinite(point.loss)]
            points = sorted(points, key=lambda point: point.loss)[:kept]
        tops = [self.fit(point, worth=worth) for point in (start, *points)]
        return max(tops, key=lambda point: point.log_evidence)

    def _starts(self, listed: Point) -> list[Point]:
        ensemble = self.ensemble
        own = [i for place in ensemble.fields(self.effect) for i in place.theta]
        thetas = np.tile(listed.theta, (_STARTS, 1))
        thetas[:, own] = ensemble.draw(_STARTS)[:, own]
        thetas[:, ensemble.noise] = ensemble.centre[ensemble.noise]
        return [replace(listed, theta=theta) for theta in thetas]

    @abstractmethod
    def predict(
        self, samples: Samples, constants: np.ndarray, coefficients: np.ndarray
    ) -> list[list[np.ndarray]]:
        """Force of constants (W, P) and coefficients (W, J) at the samples: [W][T] arrays (n,)."""

    @abstractmethod
    def least(self, point: Point) -> float:
        """The smallest factor anywhere over the largest."""

    @abstractmethod
    def is_typical(self, point: Point) -> bool:
        """Whether the change is one that the effect is known for, however large."""

    @abstractmethod
    def shape(self, point: Point) -> Shape:
        """The fitted change at five places."""


@dataclass(frozen=True, eq=False)
class OtherForm(AbstractOtherForm, AbstractCurvedForm):
    """What an effect adds, times a factor; see the module."""

    clocked: ClassVar[bool] = True

    @property
    def sds(self) -> np.ndarray:
        """(6,) of the coefficients' priors, depth first."""
        return np.tile(SD / np.arange(1, _ORDERS + 1), 2)

    def curves(self, depth: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """(6, ...) polynomials of depth, then of the clock."""
        return np.concatenate([polynomials(depth, _ORDERS), polynomials(clock, _ORDERS)])

    def without(self, constants: np.ndarray) -> np.ndarray:
        """Constants (..., P) with the effect at its null."""
        found = np.array(constants)
        for name, value in self.ensemble.effect(self.effect).null.items():
            found[..., self.ensemble.names.index(f"{self.effect}.{name}")] = value
        return found

    def combine(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The model without the effect, and what it adds times the factor."""
        full, slopes = predict_along(self.ensemble, constants, directions)
        base, base_slopes = self.beneath(constants, directions)
        curves, steep = self.over(base)
        factor = 1.0 + np.tensordot(coefficients, curves, 1)
        added = full - base
        own = base_slopes + (slopes - base_slopes) * factor
        own += base_slopes * added * np.tensordot(coefficients, steep, 1)
        return base + added * factor, np.concatenate([own, added * curves])

    def beneath(
        self, constants: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Block means (T, B) without the effect, and slopes (F, T, B) along directions (F, P)."""
        off = self.without(constants)
        moving = np.where(off == constants, directions, 0.0)  # at its null the effect stays there
        return predict_along(self.ensemble, off, moving)

    def over(self, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(J, T, B) the factor's curves at the blocks, and their slopes over the force beneath."""
        return self.at_blocks, np.zeros_like(self.at_blocks)

    def factor(self, depth: np.ndarray, clock: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """What the effect is multiplied by (..., N) at depths (N,) and clock times (N,)."""
        scales = self.experiment.scales
        curves = self.curves(depth / scales.depth, clock / scales.clock)
        return 1.0 + np.tensordot(coefficients, curves, 1)

    def at_samples(
        self, trial: Trial, time: np.ndarray, base: np.ndarray, coefficients: np.ndarray
    ) -> np.ndarray:
        """The factor (N,) at times (N,) of one trial, where the force beneath is base (N,)."""
        clock = trial.test.start_s - self.experiment.clock_zero + time
        return self.factor(trial.trajectory.displacement(time), clock, coefficients)

    def factors(self, point: Point) -> np.ndarray:
        """The factor wherever it counts."""
        _, coefficients = self.split(point.theta)
        real = np.asarray(self.ensemble.posterior.record.blocks.real)
        return 1.0 + coefficients @ self.at_blocks[:, real]

    def least(self, point: Point) -> float:
        """The smallest factor over the largest."""
        factors = self.factors(point)
        return float(factors.min() / np.abs(factors).max())

    def is_typical(self, point: Point) -> bool:
        """Never: a smooth factor could stand for anything."""
        return False

    def predict(
        self, samples: Samples, constants: np.ndarray, coefficients: np.ndarray
    ) -> list[list[np.ndarray]]:
        """The force without the effect, and what it adds times the factor."""
        full, base = samples.predict(constants), self.base(samples, constants)
        times = [t.test.time[rows] for t, rows in zip(samples.trials, samples.rows, strict=True)]
        found = []
        for with_it, without, own in zip(full, base, coefficients, strict=True):
            factors = map(self.at_samples, samples.trials, times, without, [own] * len(times))
            found.append(
                [b + (f - b) * x for f, b, x in zip(with_it, without, factors, strict=True)]
            )
        return found

    def base(self, samples: Samples, constants: np.ndarray) -> list[list[np.ndarray]]:
        """Force without the effect: [W][T] arrays (n,) of constants (W, P)."""
        return samples.predict(self.without(constants))

    def shape(self, point: Point) -> Shape:
        """The fitted factor at five depths and at five times."""
        _, coefficients = self.split(point.theta)
        scales, share = self.experiment.scales, np.linspace(0.0, 1.0, 5)
        middle = np.full(5, 0.5)
        depth, clock = scales.depth * share, scales.clock * share
        over_depth = self.factor(depth, scales.clock * middle, coefficients)
        over_clock = self.factor(scales.depth * middle, clock, coefficients)
        return Shape(self.effect, pairs(depth, over_depth), pairs(clock, over_clock))


def pairs(x: np.ndarray, factor: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Each x with its factor."""
    return tuple(zip(x.tolist(), factor.tolist(), strict=True))
