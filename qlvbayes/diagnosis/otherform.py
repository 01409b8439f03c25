r"""An effect in a form other than the list's law: what it adds, times a smooth factor.

.. math:: F = F_0 + (F_1 - F_0) \Big(1 + \sum_{k=1}^3 a_k P_k(x) + \sum_{k=1}^3 b_k P_k(y)\Big)

F_1, F_0: the force with the effect and without it; P_k: Legendre polynomials; x, y: depth and the
pad's clock, each over its range in the study. The factor is 1 where all a and b are 0. A drag that
grows with depth or a drift that levels off is then still a drag or a drift.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from qlvbayes.diagnosis.freeform import AbstractFreeForm, polynomials
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.experiment import Trial
from qlvbayes.inference.gaussnewton import Point, predict_along

_ORDERS = 3
SD = 0.7  # of the first coefficient's prior; the k-th has one k-th of it


@dataclass(frozen=True)
class Shape:
    """What an effect is multiplied by.

    over_depth: (depth in mm, factor) at mid-clock; over_clock: (clock in s, factor) at mid-depth;
    over_force: (force beneath in N, factor). Empty where the form knows no such change.
    """

    effect: str
    over_depth: tuple[tuple[float, float], ...] = ()
    over_clock: tuple[tuple[float, float], ...] = ()
    over_force: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class OtherForm(AbstractFreeForm):
    """One effect of a model, free to change its form; see the module."""

    effect: str
    replaces: ClassVar[bool] = False  # the list's law: the subset does not hold the effect

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
        off = self.without(constants)
        moving = np.where(off == constants, directions, 0.0)  # at its null the effect stays there
        full, slopes = predict_along(self.ensemble, constants, directions)
        base, base_slopes = predict_along(self.ensemble, off, moving)
        factor = 1.0 + np.tensordot(coefficients, self.at_blocks, 1)
        own = base_slopes + (slopes - base_slopes) * factor
        added = full - base
        return base + added * factor, np.concatenate([own, added * self.at_blocks])

    def factor(self, depth: np.ndarray, clock: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """What the effect is multiplied by (..., N) at depths (N,) and clock times (N,)."""
        scales = self.experiment.scales
        curves = self.curves(depth / scales.depth, clock / scales.clock)
        return 1.0 + np.tensordot(coefficients, curves, 1)

    def at_samples(
        self, trial: Trial, time: np.ndarray, base: np.ndarray, coefficients: np.ndarray
    ) -> np.ndarray:
        """The factor (..., N) at times (N,) of one trial, where the force beneath is base."""
        clock = trial.test.start_s - self.experiment.clock_zero + time
        return self.factor(trial.trajectory.displacement(time), clock, coefficients)

    def least(self, point: Point) -> float:
        """The smallest factor at any block over the largest."""
        _, coefficients = self.split(point.theta)
        factor = 1.0 + np.tensordot(coefficients, self.at_blocks, 1)
        factor = factor[np.asarray(self.ensemble.posterior.record.blocks.real)]
        return float(factor.min() / np.abs(factor).max())

    def is_typical(self, point: Point) -> bool:
        """Whether the change is one that the effect is known for, however large."""
        return False

    def predict(self, samples: Samples, points: list[Point]) -> list[list[np.ndarray]]:
        """Force of some points at each trial's samples: [W][T] arrays (n,)."""
        constants = np.stack([point.constants for point in points])
        full, base = samples.predict(constants), self.base(samples, constants)
        found = []
        for point, with_it, without in zip(points, full, base, strict=True):
            _, coefficients = self.split(point.theta)
            factors = [
                self.at_samples(trial, trial.test.time[rows], beneath, coefficients)
                for trial, rows, beneath in zip(samples.trials, samples.rows, without, strict=True)
            ]
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
