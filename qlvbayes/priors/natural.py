"""Priors whose number is left as it is, within bounds, so that a force linear in it stays linear.

A map to an unbounded number would send a bound to infinity: a mode that lies at one is then never
reached, and no normal stands for the density about it. Over its number each is quadratic.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from qlvbayes.priors.distributions import (
    AbstractPrior,
    AbstractScalarPrior,
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    Uniform,
)

Part = TypeVar("Part")

_FLAT = 0.01  # curvature over 1/width^2 that keeps a flat density normal: half a per cent of it
_LOG_ROOT = 0.5 * math.log(2.0 * math.pi)


class Quadratic(NamedTuple):
    """A log density top - precision (x - mean)^2/2 between two bounds.

    length: natural, of x; curvature: of minus the density, as a normal about a place takes it.
    """

    lowest: float
    highest: float
    length: float
    mean: float
    precision: float
    curvature: float
    top: float


class AbstractDirect(AbstractScalarPrior):
    """A prior in a number of its own, which whoever moves it keeps within its bounds."""

    inner: eqx.AbstractVar[Any]

    @property
    @abstractmethod
    def in_log(self) -> bool:
        """Whether the number is the logarithm of the value."""

    @abstractmethod
    def density(self) -> Quadratic:
        """Over the number, without JAX."""

    @abstractmethod
    def inside(self, value: Array) -> Array:
        """Whether a value is within the bounds."""

    def log_density(self, value: ArrayLike) -> Array:
        """That of the prior; none beyond its bounds."""
        inside = self.inside(jnp.asarray(value))
        return jnp.where(inside, self.inner.log_density(value), -jnp.inf)

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """The number itself, or its exponential."""
        return (jnp.exp(y), y) if self.in_log else (y, jnp.zeros_like(y))

    def unconstrain(self, value: ArrayLike) -> Array:
        """The value itself, or its logarithm."""
        number = jnp.reshape(jnp.asarray(value, dtype=float), (1,))
        return jnp.log(number) if self.in_log else number

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value."""
        return np.asarray(self.inner.draw(rng))

    def describe(self) -> str:
        """As the prior's own."""
        return str(self.inner.describe())


class Natural(AbstractDirect):
    """A normal or half-normal prior of an amplitude, taken in the amplitude itself.

    A half-normal's may then lie at zero, where its effect vanishes exactly.
    """

    inner: Any
    word: ClassVar[str] = "natural"

    @property
    def in_log(self) -> bool:
        """No."""
        return False

    def inside(self, value: Array) -> Array:
        """From zero on, of a half-normal."""
        return value >= (0.0 if isinstance(self.inner, HalfNormal) else -jnp.inf)

    @property
    def sd(self) -> float:
        """Scale of the prior."""
        return float(self.inner.sd)

    def density(self) -> Quadratic:
        """Of the normal, or the half-normal."""
        return _quadratic(self.inner)


class Positive(AbstractDirect):
    """A half-normal prior of what is no amplitude, taken in the value itself, which may be zero.

    In its logarithm the density falls without end towards zero, ever straighter: no normal stands
    for it there.
    """

    inner: Any
    word: ClassVar[str] = "positive"

    @property
    def in_log(self) -> bool:
        """No."""
        return False

    def inside(self, value: Array) -> Array:
        """From zero on."""
        return value >= 0.0

    def density(self) -> Quadratic:
        """Of the half-normal."""
        return _quadratic(self.inner)


class Bounded(AbstractDirect):
    """A uniform prior taken in the value itself, or a log-uniform one in its logarithm."""

    inner: Any
    word: ClassVar[str] = "bounded"

    @property
    def in_log(self) -> bool:
        """Of a log-uniform prior."""
        return isinstance(self.inner, LogUniform)

    def inside(self, value: Array) -> Array:
        """Between both."""
        return (value >= self.inner.low) & (value <= self.inner.high)

    def density(self) -> Quadratic:
        """Flat, but for what keeps a normal a normal."""
        low, high = float(self.inner.low), float(self.inner.high)
        if self.in_log:
            low, high = math.log(low), math.log(high)
        width = high - low
        length, top = width / math.sqrt(12.0), -math.log(width)
        return Quadratic(low, high, length, 0.5 * (low + high), 0.0, _FLAT / width**2, top)


class Logarithmic(AbstractDirect):
    """A log-normal prior, taken in the logarithm."""

    inner: Any
    word: ClassVar[str] = "logarithmic"

    @property
    def in_log(self) -> bool:
        """Yes."""
        return True

    def inside(self, value: Array) -> Array:
        """Positive."""
        return value > 0.0

    def density(self) -> Quadratic:
        """Of the normal; a factor e is its length, however wide the prior is."""
        mean, sd = float(self.inner.log_median), float(self.inner.log_sd)
        top = -math.log(sd) - _LOG_ROOT
        return Quadratic(-math.inf, math.inf, 1.0, mean, sd**-2, sd**-2, top)


def _quadratic(inner: Any) -> Quadratic:
    """Of a normal, or of a half-normal, whose length is its sd."""
    folded, sd = isinstance(inner, HalfNormal), float(inner.sd)
    mean, lowest = (0.0, 0.0) if folded else (float(inner.mean), -math.inf)
    top = -math.log(sd) - _LOG_ROOT + (math.log(2.0) if folded else 0.0)
    return Quadratic(lowest, math.inf, sd, mean, sd**-2, sd**-2, top)


def natural(prior: object) -> object:
    """The prior in its natural number where it is normal or half-normal, else as it is."""
    return Natural(prior) if isinstance(prior, Normal | HalfNormal) else prior


def in_own_numbers(part: Part) -> Part:
    """A law or effect whose priors are quadratic, but for those of several numbers."""

    def direct(prior: object) -> object:
        if isinstance(prior, LogNormal):
            return Logarithmic(prior)
        if isinstance(prior, HalfNormal):
            return Positive(prior)
        return Bounded(prior) if isinstance(prior, Uniform | LogUniform) else prior

    changed: Part = jax.tree.map(direct, part, is_leaf=lambda x: isinstance(x, AbstractPrior))
    return changed
