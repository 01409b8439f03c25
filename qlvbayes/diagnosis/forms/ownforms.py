r"""Changes that some effects are known for, of more freedom than any effect's other form.

A contact that builds up over depth, in place of one that begins at a depth: the whole force times
a factor. A leak or a drift that levels off: to what grows with the clock y is added what grows with
its logarithm,

.. math:: F = F_0 + (F_1 - F_0) \Big(1 + \frac{s}{y} \sum_{k=0}^5 a_k P_k(s)\Big), \quad
          s = \ln(1 + y/e) / \ln(1 + 1/e), \quad e = 0.05.

Friction that grows with the pressing force, and a frame that stiffens: a factor over the force
beneath, F_0 over its peak.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from qlvbayes.diagnosis.forms.drainage import PowerDrainage
from qlvbayes.diagnosis.forms.lag import SpreadLag
from qlvbayes.diagnosis.forms.otherform import SD, AbstractOtherForm, OtherForm, Shape, pairs
from qlvbayes.diagnosis.freeform import polynomials, slopes_of_polynomials
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.effects.channel_lag import ChannelLag
from qlvbayes.effects.contact_offset import ContactOffset
from qlvbayes.effects.fluid_leak import FluidLeak
from qlvbayes.effects.fluid_pressure import FluidPressure
from qlvbayes.effects.force_drift import ForceDrift
from qlvbayes.effects.frame_compliance import FrameCompliance
from qlvbayes.effects.friction import Friction
from qlvbayes.experiment import Trial
from qlvbayes.inference.gaussnewton import Point

_CONTACT_ORDERS = 5
_CLOCK_ORDERS = 6
_FORCE_ORDERS = 3
_CLOCK_SD = 1.0
_EARLY = 0.05  # of the study: up to there the clock is drawn out
_ROUNDING = 1e-9
_GRID = np.linspace(0.0, 1.0, 201)
_BACK = 0.2  # of what has come together, that may go back
_BELOW = 0.1  # of it, by which it may lie below a steady growth, or a factor below a smaller one's


@dataclass(frozen=True, eq=False)
class GradualContact(OtherForm):
    """Contact that builds up over depth instead of at one: the whole force times a factor."""

    replaces: ClassVar[bool] = True
    clocked: ClassVar[bool] = False

    @property
    def sds(self) -> np.ndarray:
        """(5,) of the coefficients' priors."""
        return SD / np.arange(1, _CONTACT_ORDERS + 1)

    def curves(self, depth: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """(5, ...) polynomials of depth; the clock has no part in it."""
        return polynomials(depth, _CONTACT_ORDERS)

    def beneath(
        self, constants: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Nothing: the factor is the whole force's."""
        shape = self.ensemble.posterior.record.blocks.force.shape
        return np.zeros(shape), np.zeros((len(directions), *shape))

    def base(self, samples: Samples, constants: np.ndarray) -> list[list[np.ndarray]]:
        """Nothing."""
        return [[np.zeros(rows.size) for rows in samples.rows] for _ in constants]


@dataclass(frozen=True, eq=False)
class LevellingOff(OtherForm):
    """What the law lets grow with the clock at one rate may be quick at first and come to rest."""

    @property
    def sds(self) -> np.ndarray:
        """(6,) of the coefficients' priors."""
        return _CLOCK_SD / np.arange(1, _CLOCK_ORDERS + 1)

    def curves(self, depth: np.ndarray, clock: np.ndarray) -> np.ndarray:
        """(6, ...) polynomials of order 0 to 5 of s, times s/y; depth has no part in it."""
        y = np.clip(clock, _ROUNDING, 1.0)
        s = np.log1p(y / _EARLY) / np.log1p(1.0 / _EARLY)
        ones = np.ones((1, *np.shape(y)))
        return s / y * np.concatenate([ones, polynomials(s, _CLOCK_ORDERS - 1)])

    def is_typical(self, point: Point) -> bool:
        """It levels off: grows, ever more slowly, and does not turn back."""
        _, coefficients = self.split(point.theta)
        clock = self.experiment.scales.clock * _GRID
        sum_ = _GRID * self.factor(np.zeros_like(clock), clock, coefficients)
        top = sum_.max()
        below = _GRID * sum_[-1] - sum_
        return bool(_fall(sum_) < _BACK * top and below.max() < _BELOW * top)


@dataclass(frozen=True, eq=False)
class WithForce(OtherForm):
    """A factor over the force beneath."""

    clocked: ClassVar[bool] = False

    @property
    def sds(self) -> np.ndarray:
        """(3,) of the coefficients' priors."""
        return SD / np.arange(1, _FORCE_ORDERS + 1)

    def over(self, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3, T, B) polynomials of the force, and their slopes."""
        peak = self.experiment.scales.force
        steep = slopes_of_polynomials(base / peak, _FORCE_ORDERS) / peak
        return polynomials(base / peak, _FORCE_ORDERS), steep

    def at_samples(
        self, trial: Trial, time: np.ndarray, base: np.ndarray, coefficients: np.ndarray
    ) -> np.ndarray:
        """The factor (N,) where the force beneath is base (N,)."""
        curves = polynomials(base / self.experiment.scales.force, _FORCE_ORDERS)
        return 1.0 + coefficients @ curves

    def factors(self, point: Point) -> np.ndarray:
        """(201,) from no force to the peak."""
        _, coefficients = self.split(point.theta)
        return 1.0 + coefficients @ polynomials(_GRID, _FORCE_ORDERS)

    def is_typical(self, point: Point) -> bool:
        """It grows with the force."""
        factor = self.factors(point)
        return bool(_fall(factor) < _BELOW * factor.max())

    def shape(self, point: Point) -> Shape:
        """The fitted factor at five forces."""
        forces = self.experiment.scales.force * np.linspace(0.0, 1.0, 5)
        return Shape(self.effect, over_force=pairs(forces, self.factors(point)[::50]))


@dataclass(frozen=True, eq=False)
class StiffeningFrame(WithForce):
    """A frame that gives way less and less: its part in the constants hides the list's law."""

    distant: ClassVar[bool] = True

    def is_typical(self, point: Point) -> bool:
        """The factor falls with the force, and the frame always gives way."""
        factor = self.factors(point)
        return bool(_fall(-factor) < _BELOW * factor.max() and factor.min() > 0.0)


def _fall(curve: np.ndarray) -> float:
    """How far a curve (N,) falls below what it had reached."""
    return float((np.maximum.accumulate(curve) - curve).max())


OWN_FORMS: dict[str, type[AbstractOtherForm]] = {
    ChannelLag.name: SpreadLag,
    ContactOffset.name: GradualContact,
    FluidLeak.name: LevellingOff,
    FluidPressure.name: PowerDrainage,
    ForceDrift.name: LevellingOff,
    FrameCompliance.name: StiffeningFrame,
    Friction.name: WithForce,
}
