"""A prior whose number is left as it is, so that a force linear in it stays linear."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from qlvbayes.priors.distributions import AbstractScalarPrior, HalfNormal, Normal


class Natural(AbstractScalarPrior):
    """A normal or half-normal prior of an amplitude, taken in the amplitude itself.

    The unconstrained number is the value: a half-normal's may then lie at zero, where its effect
    vanishes exactly, and who moves it keeps it from falling below.
    """

    inner: Any
    word: ClassVar[str] = "natural"

    @property
    def lowest(self) -> float:
        """Least value that the prior allows."""
        return 0.0 if isinstance(self.inner, HalfNormal) else -np.inf

    @property
    def sd(self) -> float:
        """Scale of the prior."""
        return float(self.inner.sd)

    @property
    def mean(self) -> float:
        """Of the normal; 0 of a half-normal."""
        return float(getattr(self.inner, "mean", 0.0))

    def log_of(self, value: float) -> float:
        """Log density at a value that the prior allows, without JAX."""
        sides = 1.0 if isinstance(self.inner, Normal) else 2.0
        z = (value - self.mean) / self.sd
        return math.log(sides / (self.sd * math.sqrt(2.0 * math.pi))) - 0.5 * z**2

    def log_density(self, value: ArrayLike) -> Array:
        """That of the prior."""
        return self.inner.log_density(value)

    def to_support(self, y: Array) -> tuple[Array, Array]:
        """The number itself."""
        return y, jnp.zeros_like(y)

    def unconstrain(self, value: ArrayLike) -> Array:
        """The value itself."""
        return jnp.reshape(jnp.asarray(value, dtype=float), (1,))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """One value."""
        return np.asarray(self.inner.draw(rng))

    def describe(self) -> str:
        """As the prior's own."""
        return str(self.inner.describe())


def natural(prior: object) -> object:
    """The prior in its natural number where it is normal or half-normal, else as it is."""
    return Natural(prior) if isinstance(prior, Normal | HalfNormal) else prior
