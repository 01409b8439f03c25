"""Define priors of one number: a density, and the map from an unconstrained number."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import fields
from typing import Any, ClassVar, TypeAlias

import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.priors.transforms import from_interval, to_interval, to_positive
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array

Constant: TypeAlias = Any
"""A constant of a law, an effect or a noise model: `Float[Array, ...]` where it is fixed, and an
`AbstractPrior` where it is free.

Equations see arrays only, because `Posterior.bind` puts one in place of every prior. A type checker
would ask each equation to allow for priors, hence Any.
"""


def log_normal_density(x: ArrayLike, mean: ArrayLike, sd: ArrayLike) -> Array:
    """Return the log density of a normal distribution at x."""
    return -0.5 * ((xp.asarray(x) - mean) / sd) ** 2 - xp.log(sd) - 0.5 * math.log(2.0 * math.pi)


class AbstractPrior(Pytree):
    """Prior of one or several constants: what is known of them before the tests.

    A prior stands in the field of a model where a number would stand: the constant is then free. It
    also maps an unconstrained vector y, in which samplers and optimisers move, to the value of the
    constants. A user's own prior extends `AbstractScalarPrior`.
    """

    @property
    @abstractmethod
    def size(self) -> int:
        """Return how many unconstrained numbers stand for the value."""

    @abstractmethod
    def constrain(self, y: Array) -> tuple[Array, Array]:
        """Return the value at y (size,), unconstrained numbers, and the log prior density over y.

        The value is a constant or an array of them; the density is normalised and includes the
        log-Jacobian of the map.
        """

    @abstractmethod
    def unconstrain(self, value: ArrayLike) -> Array:
        """Return the (size,) unconstrained numbers that ``constrain`` maps to ``value``."""

    @abstractmethod
    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the prior."""

    @abstractmethod
    def describe(self) -> str:
        """Return the prior as it is written on the command line, ``lognormal(1.8, 0.5)``."""


class AbstractScalarPrior(AbstractPrior):
    """Prior of one constant: what is known of it before the tests.

    ``word`` names the prior on the command line; the fields are its arguments, in order.
    """

    word: ClassVar[str]

    @property
    def size(self) -> int:
        """Return 1: one unconstrained number stands for the value."""
        return 1

    @abstractmethod
    def log_density(self, value: ArrayLike) -> Array:
        """Return the log density at ``value``, per unit of the value."""

    @abstractmethod
    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Return the value at an unconstrained number y, and log(d value / dy)."""

    def constrain(self, y: Array) -> tuple[Array, Array]:
        """Return the value at y, shape (1,), and the log density over y."""
        value, log_volume = self.to_support(y[0])
        return value, self.log_density(value) + log_volume

    def describe(self) -> str:
        """Return ``word(a, b)``, as the prior is written on the command line."""
        arguments = (getattr(self, field.name) for field in fields(self))
        return f"{self.word}({', '.join(f'{float(x):.4g}' for x in arguments)})"


class AbstractPositivePrior(AbstractScalarPrior):
    """Prior of one positive constant; samplers move in its logarithm."""

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Return e^y and log(d value / dy) = y."""
        return to_positive(y)

    def unconstrain(self, value: ArrayLike) -> Array:
        """Return the logarithm of the value, shape (1,)."""
        return xp.log(xp.asarray(value)[None])


class Normal(AbstractScalarPrior):
    """Normal prior of a constant.

    Parameters
    ----------
    mean, sd
        Mean and standard deviation, in the constant's unit; sd is above 0.
    """

    mean: Array | float
    sd: Array | float
    word: ClassVar[str] = "normal"

    def log_density(self, value: ArrayLike) -> Array:
        """Return the log density of the normal distribution at ``value``."""
        return log_normal_density(value, self.mean, self.sd)

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Return mean + sd y and log(sd)."""
        return self.mean + self.sd * y, xp.log(self.sd)

    def unconstrain(self, value: ArrayLike) -> Array:
        """Return (value - mean)/sd, shape (1,)."""
        return ((xp.asarray(value) - self.mean) / self.sd)[None]

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the prior."""
        return np.asarray(rng.normal(self.mean, self.sd))


class LogNormal(AbstractPositivePrior):
    """Log-normal prior of a positive constant: its logarithm is normally distributed.

    ``lognormal(1.8, 0.5)`` has the median e^1.8 = 6.05, and one standard deviation is a factor of
    e^0.5 = 1.65 either way.

    Parameters
    ----------
    log_median
        Mean of the logarithm of the constant, in its unit.
    log_sd
        Standard deviation of that logarithm, above 0.
    """

    log_median: Array | float
    log_sd: Array | float
    word: ClassVar[str] = "lognormal"

    def log_density(self, value: ArrayLike) -> Array:
        """Return the log density of the log-normal distribution."""
        positive = xp.asarray(value) > 0.0
        log_value = xp.log(xp.where(positive, value, 1.0))
        density = log_normal_density(log_value, self.log_median, self.log_sd) - log_value
        return xp.where(positive, density, -np.inf)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the prior."""
        return np.exp(rng.normal(self.log_median, self.log_sd))


class HalfNormal(AbstractPositivePrior):
    """Half-normal prior of a constant of zero or more: the absolute value of a normal number.

    Parameters
    ----------
    sd
        Standard deviation of the normal before it is folded at zero, above 0.
    """

    sd: Array | float
    word: ClassVar[str] = "halfnormal"

    def log_density(self, value: ArrayLike) -> Array:
        """Return the log density of the half-normal distribution at ``value``."""
        return log_normal_density(value, 0.0, self.sd) + math.log(2.0)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the prior."""
        return np.abs(rng.normal(0.0, self.sd))


class AbstractBoundedPrior(AbstractScalarPrior):
    """Prior of one constant that lies between two bounds."""

    low: Array | float
    high: Array | float

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Return low + (high - low) sigmoid(y) and the log-Jacobian of this map."""
        return to_interval(y, self.low, self.high)

    def unconstrain(self, value: ArrayLike) -> Array:
        """Return log((value - low)/(high - value)), shape (1,)."""
        return from_interval(value, self.low, self.high)[None]


class Uniform(AbstractBoundedPrior):
    """Uniform prior of a constant between two bounds.

    Parameters
    ----------
    low, high
        The bounds, in the constant's unit; low is below high.
    """

    low: Array | float
    high: Array | float
    word: ClassVar[str] = "uniform"

    def log_density(self, value: ArrayLike) -> Array:
        """Return -log(high - low)."""
        return -xp.log(xp.asarray(self.high) - self.low)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the prior."""
        return np.asarray(rng.uniform(self.low, self.high))


class LogUniform(AbstractBoundedPrior):
    """Log-uniform prior of a positive constant: its logarithm is uniform between two bounds.

    Parameters
    ----------
    low, high
        The bounds of the constant itself, in its unit; 0 < low < high.
    """

    low: Array | float
    high: Array | float
    word: ClassVar[str] = "loguniform"

    def log_density(self, value: ArrayLike) -> Array:
        """Return -log(value log(high/low))."""
        return -xp.log(value) - xp.log(xp.log(xp.asarray(self.high) / self.low))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the prior."""
        return np.exp(rng.uniform(np.log(self.low), np.log(self.high)))
