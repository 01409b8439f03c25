"""Priors of single numbers: a density, and the map from an unconstrained number to its support."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import fields
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.stats as jss
import numpy as np
from jaxtyping import Array, ArrayLike

from qlvbayes.priors.transforms import from_interval, to_interval, to_positive


class AbstractPrior(eqx.Module):
    """A prior of one or several constants; stands in a model where a number would.

    ``size``: unconstrained numbers it takes; ``constrain`` maps them to the value and returns the
    log of the prior's density over them (the Jacobian included), ready to be summed.
    """

    @property
    @abstractmethod
    def size(self) -> int:
        """How many unconstrained numbers it takes."""

    @abstractmethod
    def constrain(self, y: Array) -> tuple[Array, Array]:
        """(size,) to the value and the log prior density at y, normalised over y."""

    @abstractmethod
    def unconstrain(self, value: ArrayLike) -> Array:
        """The (size,) numbers that ``constrain`` maps to ``value``."""

    @abstractmethod
    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value from the prior."""

    @abstractmethod
    def describe(self) -> str:
        """As it is written on the command line."""


class AbstractScalarPrior(AbstractPrior):
    """The prior of one number."""

    word: eqx.AbstractClassVar[str]

    @property
    def size(self) -> int:
        """One."""
        return 1

    @abstractmethod
    def log_density(self, value: ArrayLike) -> Array:
        """Log density at ``value``, per unit of the value."""

    @abstractmethod
    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Unconstrained number to (value, log-Jacobian)."""

    def constrain(self, y: Array) -> tuple[Array, Array]:
        """Value and log density over y."""
        value, log_volume = self.to_support(y[0])
        return value, self.log_density(value) + log_volume

    def describe(self) -> str:
        """word(a,b), as on the command line."""
        numbers = (getattr(self, field.name) for field in fields(self))
        return f"{self.word}({', '.join(f'{float(x):.4g}' for x in numbers)})"


class AbstractPositivePrior(AbstractScalarPrior):
    """The prior of a positive number, sampled in its logarithm."""

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """E^y."""
        return to_positive(y)

    def unconstrain(self, value: ArrayLike) -> Array:
        """Log of the value."""
        return jnp.log(jnp.reshape(jnp.asarray(value, dtype=float), (1,)))


class Normal(AbstractScalarPrior):
    """Normal with mean and standard deviation."""

    mean: Any
    sd: Any
    word: ClassVar[str] = "normal"

    def log_density(self, value: ArrayLike) -> Array:
        """Log density of the normal."""
        return jss.norm.logpdf(value, self.mean, self.sd)

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Value = mean + sd y."""
        return self.mean + self.sd * y, jnp.log(self.sd)

    def unconstrain(self, value: ArrayLike) -> Array:
        """(value - mean)/sd."""
        return jnp.reshape((jnp.asarray(value, dtype=float) - self.mean) / self.sd, (1,))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value."""
        return np.asarray(rng.normal(self.mean, self.sd))


class LogNormal(AbstractPositivePrior):
    """Log-normal: log of the value is normal with mean ``log_median`` and sd ``log_sd``.

    Written ``lognormal(1.8, 0.5)``: median e^1.8 = 6.05, a factor e^0.5 = 1.65 either way.
    """

    log_median: Any
    log_sd: Any
    word: ClassVar[str] = "lognormal"

    def log_density(self, value: ArrayLike) -> Array:
        """Log density of the log-normal; minus infinity at zero, its limit."""
        positive = jnp.asarray(value) > 0.0
        log_value = jnp.log(jnp.where(positive, value, 1.0))
        density = jss.norm.logpdf(log_value, self.log_median, self.log_sd) - log_value
        return jnp.where(positive, density, -jnp.inf)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value."""
        return np.exp(rng.normal(self.log_median, self.log_sd))


class HalfNormal(AbstractPositivePrior):
    """Normal folded at zero, with scale ``sd``."""

    sd: Any
    word: ClassVar[str] = "halfnormal"

    def log_density(self, value: ArrayLike) -> Array:
        """Log density of the half-normal."""
        return jss.norm.logpdf(value, 0.0, self.sd) + jnp.log(2.0)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value."""
        return np.abs(rng.normal(0.0, self.sd))


class AbstractBoundedPrior(AbstractScalarPrior):
    """The prior of a number between two bounds."""

    low: eqx.AbstractVar[Any]
    high: eqx.AbstractVar[Any]

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """Low + (high - low) sigmoid(y)."""
        return to_interval(y, self.low, self.high)

    def unconstrain(self, value: ArrayLike) -> Array:
        """Log odds of the value's place between the bounds."""
        return jnp.reshape(from_interval(value, self.low, self.high), (1,))


class Uniform(AbstractBoundedPrior):
    """Uniform between ``low`` and ``high``."""

    low: Any
    high: Any
    word: ClassVar[str] = "uniform"

    def log_density(self, value: ArrayLike) -> Array:
        """-log(high - low)."""
        return -jnp.log(jnp.asarray(self.high) - self.low)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value."""
        return np.asarray(rng.uniform(self.low, self.high))


class LogUniform(AbstractBoundedPrior):
    """Uniform in the logarithm between ``low`` and ``high``, both positive."""

    low: Any
    high: Any
    word: ClassVar[str] = "loguniform"

    def log_density(self, value: ArrayLike) -> Array:
        """-log(value log(high/low))."""
        return -jnp.log(value) - jnp.log(jnp.log(jnp.asarray(self.high) / self.low))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value."""
        return np.exp(rng.uniform(np.log(self.low), np.log(self.high)))
