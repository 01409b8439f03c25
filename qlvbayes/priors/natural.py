"""Priors whose number is left as it is, within bounds, so that a force linear in it stays linear.

A map to an unbounded number would send a bound to infinity: a mode that lies at one is then never
reached, and no normal stands for the density about it.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from qlvbayes.priors.distributions import (
    AbstractPrior,
    AbstractScalarPrior,
    HalfNormal,
    LogUniform,
    Normal,
    Uniform,
)

Part = TypeVar("Part")

_FLAT = 0.01  # curvature over 1/width^2 that keeps a flat density normal: half a per cent of it


class AbstractDirect(AbstractScalarPrior):
    """A prior in a number of its own, which whoever moves it keeps within its bounds."""

    inner: eqx.AbstractVar[Any]

    @property
    @abstractmethod
    def lowest(self) -> float:
        """Least number."""

    @property
    @abstractmethod
    def highest(self) -> float:
        """Largest number."""

    @property
    @abstractmethod
    def sd(self) -> float:
        """Natural length."""

    @property
    @abstractmethod
    def curvature(self) -> float:
        """Of minus the log density."""

    @abstractmethod
    def log_of(self, number: float) -> float:
        """Log density at a number within the bounds, without JAX."""

    @abstractmethod
    def gradient(self, number: float) -> float:
        """Of minus the log density."""

    @abstractmethod
    def value_of(self, number: np.ndarray) -> np.ndarray:
        """The constant's value."""

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
    def lowest(self) -> float:
        """Least value that the prior allows."""
        return 0.0 if isinstance(self.inner, HalfNormal) else -math.inf

    @property
    def highest(self) -> float:
        """None."""
        return math.inf

    @property
    def sd(self) -> float:
        """Scale of the prior."""
        return float(self.inner.sd)

    @property
    def mean(self) -> float:
        """Of the normal; 0 of a half-normal."""
        return float(getattr(self.inner, "mean", 0.0))

    @property
    def curvature(self) -> float:
        """1/sd^2."""
        return self.sd**-2

    def gradient(self, number: float) -> float:
        """(number - mean)/sd^2."""
        return (number - self.mean) / self.sd**2

    def log_of(self, number: float) -> float:
        """Of the normal, or the half-normal."""
        sides = 1.0 if isinstance(self.inner, Normal) else 2.0
        z = (number - self.mean) / self.sd
        return math.log(sides / (self.sd * math.sqrt(2.0 * math.pi))) - 0.5 * z**2

    def value_of(self, number: np.ndarray) -> np.ndarray:
        """The number itself."""
        return number

    def log_density(self, value: ArrayLike) -> Array:
        """That of the prior; none below its least value."""
        return jnp.where(jnp.asarray(value) >= self.lowest, self.inner.log_density(value), -jnp.inf)

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """The number itself."""
        return y, jnp.zeros_like(y)

    def unconstrain(self, value: ArrayLike) -> Array:
        """The value itself."""
        return jnp.reshape(jnp.asarray(value, dtype=float), (1,))


class Bounded(AbstractDirect):
    """A uniform prior taken in the value itself, or a log-uniform one in its logarithm."""

    inner: Any
    word: ClassVar[str] = "bounded"

    @property
    def _is_log(self) -> bool:
        return isinstance(self.inner, LogUniform)

    @property
    def lowest(self) -> float:
        """Of the value, or of its logarithm."""
        return math.log(self.inner.low) if self._is_log else float(self.inner.low)

    @property
    def highest(self) -> float:
        """Of the value, or of its logarithm."""
        return math.log(self.inner.high) if self._is_log else float(self.inner.high)

    @property
    def sd(self) -> float:
        """Of the uniform density."""
        return (self.highest - self.lowest) / math.sqrt(12.0)

    @property
    def curvature(self) -> float:
        """None, but for what keeps a normal a normal."""
        return _FLAT / (self.highest - self.lowest) ** 2

    def gradient(self, number: float) -> float:
        """None."""
        return 0.0

    def log_of(self, number: float) -> float:
        """-log(highest - lowest)."""
        return -math.log(self.highest - self.lowest)

    def value_of(self, number: np.ndarray) -> np.ndarray:
        """The number itself, or its exponential."""
        return np.exp(number) if self._is_log else number

    def log_density(self, value: ArrayLike) -> Array:
        """That of the prior; none beyond its bounds."""
        place = jnp.asarray(value)
        inside = (place >= self.inner.low) & (place <= self.inner.high)
        return jnp.where(inside, self.inner.log_density(value), -jnp.inf)

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """The number itself, or its exponential."""
        return (jnp.exp(y), y) if self._is_log else (y, jnp.zeros_like(y))

    def unconstrain(self, value: ArrayLike) -> Array:
        """The value itself, or its logarithm."""
        number = jnp.reshape(jnp.asarray(value, dtype=float), (1,))
        return jnp.log(number) if self._is_log else number


def natural(prior: object) -> object:
    """The prior in its natural number where it is normal or half-normal, else as it is."""
    return Natural(prior) if isinstance(prior, Normal | HalfNormal) else prior


def within_bounds(part: Part) -> Part:
    """A law or effect whose uniform and log-uniform priors are `Bounded`."""

    def bounded(prior: object) -> object:
        return Bounded(prior) if isinstance(prior, Uniform | LogUniform) else prior

    changed: Part = jax.tree.map(bounded, part, is_leaf=lambda x: isinstance(x, AbstractPrior))
    return changed
