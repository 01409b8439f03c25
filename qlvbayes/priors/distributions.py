r"""Define priors of one number: a density over the number itself, or its logarithm, within bounds.

A map to an unbounded number would send a bound to infinity: an optimiser would never reach a mode
that lies at a bound, and no normal density would approximate the posterior around it. Over the
coordinate chosen here a force that is linear in a constant stays linear, and each log density is
quadratic.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import fields
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array

Constant: TypeAlias = Any
"""A constant of a law, an effect or a noise model: `Float[Array, ...]` where it is fixed, and an
`AbstractPrior` where it is free.

Equations see arrays only, because a number is put in place of every prior. A type checker would ask
each equation to allow for priors, hence Any.
"""
_FLAT = 0.01  # curvature, over 1/width^2, that a flat density is given for its normal approximation
_LOG_ROOT = 0.5 * math.log(2.0 * math.pi)


def log_normal_density(x: ArrayLike, mean: ArrayLike, sd: ArrayLike) -> Array:
    """Return the log density of a normal distribution at x."""
    return -0.5 * ((xp.asarray(x) - mean) / sd) ** 2 - xp.log(sd) - _LOG_ROOT


class AbstractPrior(Pytree):
    """Prior of one or several constants: what is known of them before the tests.

    A prior stands in the field of a model where a number would stand: the constant is then free. It
    also maps a vector y of coordinates, in which samplers and optimisers move, to the value of the
    constants.
    """

    @property
    @abstractmethod
    def size(self) -> int:
        """Return how many coordinates stand for the value."""

    @abstractmethod
    def constrain(self, y: Array) -> tuple[Array, Array]:
        """Return the value at y (size,), coordinates, and the log prior density over y.

        The value is a constant or an array of them; the density is normalised and includes the
        log-Jacobian of the map.
        """

    @abstractmethod
    def unconstrain(self, value: ArrayLike) -> Array:
        """Return the (size,) coordinates that ``constrain`` maps to ``value``."""

    @abstractmethod
    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the prior."""

    @abstractmethod
    def describe(self) -> str:
        """Return the prior as it is written on the command line, ``lognormal(1.8, 0.5)``."""


class QuadraticDensity(NamedTuple):
    """Log density top - precision (y - mean)^2/2 between two bounds of a coordinate y.

    ``length`` is a natural step of y; ``curvature`` is minus the second derivative that a normal
    approximation of the density takes.
    """

    lowest: float
    highest: float
    length: float
    mean: float
    precision: float
    curvature: float
    top: float


class AbstractScalarPrior(AbstractPrior):
    """Prior of one constant, whose log density is quadratic over its coordinate within bounds.

    ``word`` names the prior on the command line; the fields are its arguments, in order. The
    coordinate is the constant itself, or in sds from its mean where it may have either sign, or its
    logarithm where ``in_log`` says so; an optimiser has to stay within the bounds. Any other prior
    of a user's own extends `AbstractPrior`.
    """

    word: ClassVar[str]
    in_log: ClassVar[bool] = False

    @property
    def size(self) -> int:
        """Return 1: one coordinate stands for the value."""
        return 1

    @property
    def affine(self) -> tuple[Any, Any]:
        """Return shift and scale of the value over its coordinate, if that is no logarithm."""
        return 0.0, 1.0

    @abstractmethod
    def log_density(self, value: ArrayLike) -> Array:
        """Return the log density at ``value``, per unit of the value; -inf outside the bounds."""

    @abstractmethod
    def density(self) -> QuadraticDensity:
        """Return the log density over the coordinate, as numbers."""

    def constrain(self, y: Array) -> tuple[Array, Array]:
        """Return the value at y, shape (1,), and the log density over y."""
        shift, scale = self.affine
        value = xp.exp(y[0]) if self.in_log else shift + scale * y[0]
        return value, self.log_density(value) + (y[0] if self.in_log else xp.log(scale))

    def unconstrain(self, value: ArrayLike) -> Array:
        """Return the coordinate of the value, shape (1,)."""
        one, (shift, scale) = xp.asarray(value)[None], self.affine
        return xp.log(one) if self.in_log else (one - shift) / scale

    def describe(self) -> str:
        """Return ``word(a, b)``, as the prior is written on the command line."""
        arguments = (getattr(self, field.name) for field in fields(self))
        return f"{self.word}({', '.join(f'{float(x):.4g}' for x in arguments)})"


class AbstractPositivePrior(AbstractScalarPrior):
    """Prior of one positive constant."""


class Normal(AbstractScalarPrior):
    """Normal prior of a constant: mean and standard deviation, above 0, in its unit."""

    mean: Array | float
    sd: Array | float
    word = "normal"

    @property
    def affine(self) -> tuple[Any, Any]:
        return self.mean, self.sd

    def log_density(self, value: ArrayLike) -> Array:
        return log_normal_density(value, self.mean, self.sd)

    def density(self) -> QuadraticDensity:
        return _normal(0.0, 1.0)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        return np.asarray(rng.normal(self.mean, self.sd))


class SignedAmplitude(Normal):
    """Normal prior over an amplitude itself, with which an effect's force is linear from zero."""

    @property
    def affine(self) -> tuple[Any, Any]:
        return 0.0, 1.0

    def density(self) -> QuadraticDensity:
        return _normal(float(self.mean), float(self.sd))


class LogNormal(AbstractPositivePrior):
    """Log-normal prior of a positive constant: its logarithm is normally distributed.

    ``lognormal(1.8, 0.5)`` has the median e^1.8 = 6.05, and one standard deviation is a factor of
    e^0.5 = 1.65 either way. The arguments are the mean of the logarithm of the constant, in its
    unit, and the standard deviation of that logarithm, above 0.
    """

    log_median: Array | float
    log_sd: Array | float
    word = "lognormal"
    in_log = True

    def log_density(self, value: ArrayLike) -> Array:
        positive = xp.asarray(value) > 0.0
        log_value = xp.log(xp.where(positive, value, 1.0))
        density = log_normal_density(log_value, self.log_median, self.log_sd) - log_value
        return xp.where(positive, density, -np.inf)

    def density(self) -> QuadraticDensity:
        return _normal(float(self.log_median), float(self.log_sd))._replace(length=1.0)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        return np.exp(rng.normal(self.log_median, self.log_sd))


class HalfNormal(AbstractPositivePrior):
    """Half-normal prior of a constant of zero or more: the absolute value of a normal number.

    The value may be zero, where an effect vanishes: over its logarithm the density would fall
    without end towards zero, along an ever straighter line, which no normal density approximates.
    The argument is the standard deviation of the normal before it is folded at zero, above 0.
    """

    sd: Array | float
    word = "halfnormal"

    def log_density(self, value: ArrayLike) -> Array:
        density = log_normal_density(value, 0.0, self.sd) + math.log(2.0)
        return xp.where(xp.asarray(value) >= 0.0, density, -np.inf)

    def density(self) -> QuadraticDensity:
        whole = _normal(0.0, float(self.sd))
        return whole._replace(lowest=0.0, top=whole.top + math.log(2.0))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        return np.abs(rng.normal(0.0, self.sd))


class Uniform(AbstractScalarPrior):
    """Uniform prior of a constant between two bounds in its unit, low below high."""

    low: Array | float
    high: Array | float
    word = "uniform"

    def log_density(self, value: ArrayLike) -> Array:
        return _between(value, self.low, self.high, -xp.log(xp.asarray(self.high) - self.low))

    def density(self) -> QuadraticDensity:
        return _flat(float(self.low), float(self.high))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        return np.asarray(rng.uniform(self.low, self.high))


class LogUniform(AbstractScalarPrior):
    """Log-uniform prior of a positive constant: its logarithm is uniform between two bounds.

    These are the bounds of the constant itself, in its unit: 0 < low < high.
    """

    low: Array | float
    high: Array | float
    word = "loguniform"
    in_log = True

    def log_density(self, value: ArrayLike) -> Array:
        inverse = -xp.log(value) - xp.log(xp.log(xp.asarray(self.high) / self.low))
        return _between(value, self.low, self.high, inverse)

    def density(self) -> QuadraticDensity:
        return _flat(math.log(float(self.low)), math.log(float(self.high)))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        return np.exp(rng.uniform(np.log(self.low), np.log(self.high)))


def _between(value: ArrayLike, low: ArrayLike, high: ArrayLike, density: Array) -> Array:
    """Return a log density where a value lies between two bounds, and minus infinity elsewhere."""
    inside = (xp.asarray(value) >= low) & (xp.asarray(value) <= high)
    return xp.where(inside, density, -np.inf)


def _normal(mean: float, sd: float) -> QuadraticDensity:
    top = -math.log(sd) - _LOG_ROOT
    return QuadraticDensity(-math.inf, math.inf, sd, mean, sd**-2, sd**-2, top)


def _flat(low: float, high: float) -> QuadraticDensity:
    """Return a flat log density, with a small curvature for its normal approximation."""
    width = high - low
    length, top = width / math.sqrt(12.0), -math.log(width)
    return QuadraticDensity(low, high, length, 0.5 * (low + high), 0.0, _FLAT / width**2, top)
