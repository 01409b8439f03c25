"""Define priors over the value itself, or its logarithm, within bounds.

A map to an unbounded number would send a bound to infinity: an optimiser would never reach a mode
that lies at a bound, and no normal density would approximate the posterior around it. Over the
coordinate chosen here a force that is linear in a constant stays linear, and each log density is
quadratic.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import ArrayLike

from qlvbayes import xp
from qlvbayes.priors.distributions import (
    AbstractPrior,
    AbstractScalarPrior,
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    Uniform,
)
from qlvbayes.xp import Array

Part = TypeVar("Part")

_FLAT = 0.01  # curvature, over 1/width^2, that a flat density is given for its normal approximation
_LOG_ROOT = 0.5 * math.log(2.0 * math.pi)


class QuadraticDensity(NamedTuple):
    """Log density top - precision (x - mean)^2/2 between two bounds of x.

    ``length`` is a natural step of x; ``curvature`` is minus the second derivative that a normal
    approximation of the density takes.
    """

    lowest: float
    highest: float
    length: float
    mean: float
    precision: float
    curvature: float
    top: float


class AbstractDirect(AbstractScalarPrior):
    """Prior over a bounded coordinate; the optimiser has to stay within the bounds."""

    inner: AbstractScalarPrior

    @property
    @abstractmethod
    def in_log(self) -> bool:
        """Return whether the coordinate is the logarithm of the value."""

    @abstractmethod
    def density(self) -> QuadraticDensity:
        """Return the log density over the coordinate, computed without JAX."""

    @abstractmethod
    def inside(self, value: Array) -> Array:
        """Return whether a value lies within the bounds."""

    def log_density(self, value: ArrayLike) -> Array:
        """Return the log density of the inner prior, and minus infinity outside its bounds."""
        inside = self.inside(xp.asarray(value))
        return xp.where(inside, self.inner.log_density(value), -np.inf)

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Return the value at a coordinate y, and log(d value / dy)."""
        return (xp.exp(y), y) if self.in_log else (y, xp.zeros_like(y))

    def unconstrain(self, value: ArrayLike) -> Array:
        """Return the coordinate of a value, shape (1,)."""
        coordinate = xp.asarray(value)[None]
        return xp.log(coordinate) if self.in_log else coordinate

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return one value drawn from the inner prior."""
        return np.asarray(self.inner.draw(rng))

    def describe(self) -> str:
        """Return the description of the inner prior."""
        return str(self.inner.describe())


class Natural(AbstractDirect):
    """Prior of an amplitude over the amplitude itself; it is normal or half-normal.

    An amplitude with a half-normal prior may then be exactly zero, where its effect vanishes.
    """

    inner: Normal | HalfNormal
    word: ClassVar[str] = "natural"

    @property
    def in_log(self) -> bool:
        """Return False: the coordinate is the amplitude."""
        return False

    def inside(self, value: Array) -> Array:
        """Return whether an amplitude is allowed: any for a normal, zero or more if half-normal."""
        return value >= (0.0 if isinstance(self.inner, HalfNormal) else -np.inf)

    @property
    def sd(self) -> float:
        """Return the standard deviation of the prior, for a half-normal before it is folded."""
        return float(self.inner.sd)

    def density(self) -> QuadraticDensity:
        """Return the log density of the normal or half-normal."""
        return _quadratic(self.inner)


class Positive(AbstractDirect):
    """Half-normal prior over the value itself, for a constant that is no amplitude.

    The value may be zero. Over its logarithm the density would fall without end towards zero, along
    an ever straighter line, which no normal density approximates.
    """

    inner: HalfNormal
    word: ClassVar[str] = "positive"

    @property
    def in_log(self) -> bool:
        """Return False: the coordinate is the value."""
        return False

    def inside(self, value: Array) -> Array:
        """Return whether a value is zero or more."""
        return value >= 0.0

    def density(self) -> QuadraticDensity:
        """Return the log density of the half-normal."""
        return _quadratic(self.inner)


class Bounded(AbstractDirect):
    """Uniform prior over the value itself, or log-uniform prior over its logarithm."""

    inner: Uniform | LogUniform
    word: ClassVar[str] = "bounded"

    @property
    def in_log(self) -> bool:
        """Return whether the prior is log-uniform."""
        return isinstance(self.inner, LogUniform)

    def inside(self, value: Array) -> Array:
        """Return whether a value lies between the bounds."""
        return (value >= self.inner.low) & (value <= self.inner.high)

    def density(self) -> QuadraticDensity:
        """Return the flat log density, with a small curvature for its normal approximation."""
        low, high = float(self.inner.low), float(self.inner.high)
        if self.in_log:
            low, high = math.log(low), math.log(high)
        width = high - low
        length, top = width / math.sqrt(12.0), -math.log(width)
        return QuadraticDensity(low, high, length, 0.5 * (low + high), 0.0, _FLAT / width**2, top)


class Logarithmic(AbstractDirect):
    """Log-normal prior over the logarithm of the value."""

    inner: LogNormal
    word: ClassVar[str] = "logarithmic"

    @property
    def in_log(self) -> bool:
        """Return True: the coordinate is the logarithm of the value."""
        return True

    def inside(self, value: Array) -> Array:
        """Return whether a value is positive."""
        return value > 0.0

    def density(self) -> QuadraticDensity:
        """Return the log density of the normal; its natural step is always a factor e."""
        mean, sd = float(self.inner.log_median), float(self.inner.log_sd)
        top = -math.log(sd) - _LOG_ROOT
        return QuadraticDensity(-math.inf, math.inf, 1.0, mean, sd**-2, sd**-2, top)


def _quadratic(inner: Any) -> QuadraticDensity:
    """Return the log density of a normal, or of a half-normal; its natural step is the sd."""
    folded, sd = isinstance(inner, HalfNormal), float(inner.sd)
    mean, lowest = (0.0, 0.0) if folded else (float(inner.mean), -math.inf)
    top = -math.log(sd) - _LOG_ROOT + (math.log(2.0) if folded else 0.0)
    return QuadraticDensity(lowest, math.inf, sd, mean, sd**-2, sd**-2, top)


def natural(prior: object) -> object:
    """Return a normal or half-normal prior over the value itself, and any other prior unchanged."""
    return Natural(prior) if isinstance(prior, Normal | HalfNormal) else prior


def in_quadratic_coordinates(part: Part) -> Part:
    """Return a law or effect whose scalar priors are all quadratic over their own coordinates."""

    def direct(prior: object) -> object:
        if isinstance(prior, LogNormal):
            return Logarithmic(prior)
        if isinstance(prior, HalfNormal):
            return Positive(prior)
        return Bounded(prior) if isinstance(prior, Uniform | LogUniform) else prior

    changed: Part = jax.tree.map(direct, part, is_leaf=lambda x: isinstance(x, AbstractPrior))
    return changed
