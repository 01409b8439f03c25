"""Describe measurement noise: its constants, and the standard deviation of single readings."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar, Self

import numpy as np

from qlvbayes.io import catalogue
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.motion.noisefloor.floor import NoiseFloor
from qlvbayes.motion.record import Blocks
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import Pytree, constant
from qlvbayes.xp import Array

__all__ = ["NOISES", "AbstractNoise", "Correlated", "Floor", "White"]


class AbstractNoise(Pytree):
    """Noise model: what its constants are called and mean.

    Each field is a constant of the noise: a number where it is fixed, a prior where it is free, and
    nan where it is measured. A class declares its ``name`` after ``--noise``, the kind of unit of
    each constant (``units``) and its meaning (``meanings``), and what the report says of the whole
    (``words``). Its likelihood is in `qlvbayes.fitting.marginal_likelihood`.

    The sd of a sample is multiplied by ``weight`` (a measured sd over its mean in the pad) and by
    ``scale`` (growth of the measured noise with the force), and the variances ``extra**2`` and
    ``timing**2``, which come from the motion, are added. See `qlvbayes.motion.record.Blocks`.
    """

    name: ClassVar[str]
    units: ClassVar[dict[str, str]]
    meanings: ClassVar[dict[str, str]]
    words: ClassVar[str]
    prefix: ClassVar[str] = "noise."
    neutral: ClassVar[dict[str, float]] = {}  # constants that a posterior may leave out, by value

    @abstractmethod
    def sample_sd(self, samples: Blocks) -> Array:
        """Return the standard deviation (N) of the noise of samples, each a block of its own."""


class White(AbstractNoise):
    """Independent normal noise of every sample."""

    white: Constant = constant("force", "white noise, one standard deviation")
    name: ClassVar[str] = "white"
    words: ClassVar[str] = (
        "independent normal noise, whose standard deviation is fitted with the rest"
    )

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the noise with its sd within a factor of 3 of the measured noise."""
        return cls(lognormal(scales.noise, 3.0))

    def sample_sd(self, samples: Blocks) -> Array:
        """Return white times weight (N)."""
        return self.white * np.asarray(samples.weight)


class Correlated(AbstractNoise):
    """White noise plus an Ornstein-Uhlenbeck process, as a load cell has.

    The process has cov(t, s) = ou^2 e^{-abs(t - s)/tau}. Measured sds weight the white part only: a
    correlated part proportional to the data would draw a fit below them (Peelle's puzzle). It is
    how the noise floor counts among the constants of a hypothesis.
    """

    white: Constant = constant("force", "white noise, one standard deviation")
    ou: Constant = constant("force", "correlated noise, one standard deviation")
    tau: Constant = constant("time", "correlation time of that noise")
    name: ClassVar[str] = "correlated"

    @classmethod
    def from_floor(cls, floor: NoiseFloor) -> Correlated:
        """Return the noise that was measured as the noise floor."""
        return cls(*map(np.asarray, (floor.white, floor.ou, floor.tau)))

    def sample_sd(self, samples: Blocks) -> Array:
        """Return the square root of (white weight)^2 + ou^2 (N)."""
        return np.hypot(self.white * np.asarray(samples.weight), self.ou)


class Floor(Correlated):
    """Noise floor as measured, not fitted, in addition to what a model misses.

    By itself this is the noise without a discrepancy. ``white``, ``ou`` and ``tau`` are nan where
    they are the measured ones. ``remainder`` is the size of the discrepancy (N): its standard
    deviation where the force is largest. ``factor`` and ``remainder`` are nan where the likelihood
    sums over them.
    """

    factor: Constant = constant("count", "noise in the fit over noise measured at rest")
    remainder: Constant = constant("force", "what the model misses, one standard deviation")
    name: ClassVar[str] = "floor"
    neutral: ClassVar[dict[str, float]] = {"factor": 1.0, "remainder": 0.0}
    words: ClassVar[str] = (
        "as measured at rest, without the model, and not fitted; what the model misses goes into a "
        "discrepancy of smooth functions and a rough part, whose size (noise.remainder) is summed "
        "over with a prior that costs"
    )

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the noise as measured, its discrepancy's size summed over; nothing is free."""
        return cls(*5 * [math.nan])

    def sample_sd(self, samples: Blocks) -> Array:
        """Return the square root of (white weight)^2 + ou^2, times the factor (N)."""
        return self.factor * super().sample_sd(samples)


def neutral_names(kind: type[AbstractNoise]) -> dict[str, float]:
    """Return the constants that a posterior may leave out, by name, with their values."""
    return {kind.prefix + name: value for name, value in kind.neutral.items()}


NOISES: dict[str, type[White | Floor]] = catalogue.loaded(catalogue.NOISES)
"""The noise models by name, the default first."""
