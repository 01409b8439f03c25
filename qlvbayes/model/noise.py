"""Define measurement noise: its likelihood, of samples or of block averages, and its draws.

A new noise model is one class here, and a line in ``NOISES`` of ``io.catalogue``; its fields are
numbers or priors.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar, NamedTuple, Self

import jax
import jax.numpy as jnp
import jax.scipy.stats as jss
from jaxtyping import Array

from qlvbayes.io import catalogue
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.motion.noisefloor.floor import NoiseFloor
from qlvbayes.motion.record import Blocks
from qlvbayes.priors import HalfNormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import Pytree

__all__ = ["NOISES", "AbstractNoise", "Correlated", "Floor", "White"]


class AbstractNoise(Pytree):
    """Noise model: its likelihood and its draws.

    Each field is a constant of the noise: a number where it is fixed, a prior where it is free. A
    class declares its ``name`` after ``--noise``, the kind of unit of each constant (``units``)
    and its meaning (``meanings``), and what the report says of the whole (``words``).

    The sd of a sample is multiplied by ``weight`` (a measured sd over its mean in the pad).
    Models of normal noise also multiply it by ``scale`` (growth of the measured noise with the
    force), and add the variances ``extra**2`` and ``timing**2``, which come from the motion. See
    `qlvbayes.motion.record.Blocks`.
    """

    name: ClassVar[str]
    units: ClassVar[dict[str, str]]
    meanings: ClassVar[dict[str, str]]
    words: ClassVar[str]
    prefix: ClassVar[str] = "noise."

    @classmethod
    @abstractmethod
    def default(cls, scales: Scales) -> Self:
        """Return the noise under weak priors, scaled to the noise that was measured."""

    @abstractmethod
    def log_likelihoods(self, residual: Array, blocks: Blocks) -> Array:
        """Return (B,) log densities of each block's residual, given the blocks before it.

        Parameters
        ----------
        residual
            (B,) measured minus predicted block means, in N.
        blocks
            The blocks of samples that were averaged; in padding the log density is 0.
            ``blocks.force`` has the measured means (N).
        """

    @abstractmethod
    def draw(self, key: Array, blocks: Blocks) -> Array:
        """Return one realisation (B,) of the noise of the block averages (N)."""

    @abstractmethod
    def sample_sd(self, samples: Blocks) -> Array:
        """Return the standard deviation (N) of the noise of samples, each a block of its own."""


class AbstractGaussian(AbstractNoise):
    """Normal noise, whose likelihood is that of its innovations.

    Innovations are linear in the residual, so that the same filter whitens a model's sensitivities.
    """

    @abstractmethod
    def innovations(self, residual: Array, blocks: Blocks) -> tuple[Array, Array]:
        """Return (B,) innovations of the residuals (N), and their variances (N2).

        An innovation is what a residual exceeds its expectation by, given the residuals before. In
        padding the innovation is 0 and the variance 1.
        """

    def log_likelihoods(self, residual: Array, blocks: Blocks) -> Array:
        """Return the (B,) log densities of the innovations."""
        errors, variances = self.innovations(residual, blocks)
        density = jss.norm.logpdf(errors, 0.0, jnp.sqrt(variances))
        return jnp.where(blocks.real, density, 0.0)


class White(AbstractGaussian):
    """Independent normal noise of every sample.

    white: Standard deviation of one sample (N).
    """

    white: Constant
    name: ClassVar[str] = "white"
    units: ClassVar[dict[str, str]] = {"white": "force"}
    meanings: ClassVar[dict[str, str]] = {"white": "white noise, one standard deviation"}
    words: ClassVar[str] = (
        "independent normal noise, whose standard deviation is fitted with the rest"
    )

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the noise with its sd within a factor of 3 of the measured noise."""
        return cls(lognormal(scales.noise, 3.0))

    def _scale(self, blocks: Blocks) -> Array:
        own = self.white * blocks.weight * blocks.scale
        return jnp.hypot(own / jnp.sqrt(blocks.count), _motion_sd(blocks))

    def innovations(self, residual: Array, blocks: Blocks) -> tuple[Array, Array]:
        """Return the residuals, of variance (white scale)^2/count + extra^2 + timing^2."""
        variances = jnp.where(blocks.real, self._scale(blocks) ** 2, 1.0)
        return jnp.where(blocks.real, residual, 0.0), variances

    def draw(self, key: Array, blocks: Blocks) -> Array:
        """Return normal noise of the variance that ``innovations`` has."""
        return self._scale(blocks) * jax.random.normal(key, blocks.force.shape)

    def sample_sd(self, samples: Blocks) -> Array:
        """Return white times weight (N)."""
        return self.white * samples.weight


class Correlated(AbstractGaussian):
    """White noise plus an Ornstein-Uhlenbeck process, as a load cell has.

    The process has cov(t, s) = ou^2 e^{-abs(t - s)/tau}. The likelihood is a Kalman filter, O(B),
    exact for averages over evenly spaced samples and for uneven gaps between them. Measured sds
    weight the white part only: a correlated part proportional to the data would draw the fit below
    them (Peelle's puzzle). Noise that grows with the force is the same process times
    ``Blocks.scale``; errors of the motion and of its times add ``Blocks.extra`` and
    ``Blocks.timing`` once a block.

    white: Standard deviation of the white part (N); ou: Stationary standard deviation of the
    correlated part (N); tau: Its correlation time (s).
    """

    white: Constant
    ou: Constant
    tau: Constant
    name: ClassVar[str] = "correlated"
    units: ClassVar[dict[str, str]] = {"white": "force", "ou": "force", "tau": "time"}
    meanings: ClassVar[dict[str, str]] = {
        **White.meanings,
        "ou": "correlated noise, one standard deviation",
        "tau": "correlation time of that noise",
    }
    words: ClassVar[str] = (
        "white noise plus an Ornstein-Uhlenbeck process (a load cell's noise lasts from sample to "
        "sample), whose standard deviations and correlation time are fitted with the rest"
    )

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the noise near what was measured inside holds without the model."""
        return cls(
            lognormal(scales.white, scales.white_factor),
            HalfNormal(3.0 * scales.noise),
            lognormal(scales.tau, scales.tau_factor),
        )

    @classmethod
    def from_floor(cls, floor: NoiseFloor) -> Correlated:
        """Return the noise that was measured as the noise floor."""
        return cls(*map(jnp.asarray, (floor.white, floor.ou, floor.memory)))

    def innovations(self, residual: Array, blocks: Blocks) -> tuple[Array, Array]:
        """Return the innovations of a Kalman filter, and their variances."""
        links = _links(blocks, self.tau)
        white = (self.white * blocks.weight) ** 2 / blocks.count
        white += (_motion_sd(blocks) / blocks.scale) ** 2

        def step(state: tuple[Array, Array], block: tuple) -> tuple[tuple[Array, Array], tuple]:
            link, white_variance, value, real = block
            mean = link.gap * state[0]
            variance = link.gap**2 * state[1] + self.ou**2 * (1.0 - link.gap**2)
            error = value - link.mean * mean
            spread = link.mean**2 * variance + self.ou**2 * link.mean_variance + white_variance
            shared = link.span * link.mean * variance + self.ou**2 * link.shared
            gain = shared / spread
            after = (
                link.span * mean + gain * error,
                link.span**2 * variance + self.ou**2 * (1.0 - link.span**2) - gain * shared,
            )
            kept = jax.tree.map(lambda new, old: jnp.where(real, new, old), after, state)
            return kept, (error, spread)

        start = (jnp.zeros(()), self.ou**2 * jnp.ones(()))
        _, (errors, spreads) = jax.lax.scan(
            step, start, (links, white, residual / blocks.scale, blocks.real)
        )
        errors, spreads = errors * blocks.scale, spreads * blocks.scale**2
        return jnp.where(blocks.real, errors, 0.0), jnp.where(blocks.real, spreads, 1.0)

    def draw(self, key: Array, blocks: Blocks) -> Array:
        """Return one realisation (B,), by the same recursion."""
        links = _links(blocks, self.tau)
        draws = jax.random.normal(key, (4, *blocks.force.shape))

        def step(last: Array, block: tuple) -> tuple[Array, Array]:
            link, (jump, inner, outer, _) = block
            first = link.gap * last + self.ou * jnp.sqrt(1.0 - link.gap**2) * jump
            mean_sd = jnp.sqrt(link.mean_variance)
            slope = link.shared / jnp.where(mean_sd > 0.0, mean_sd, 1.0)
            rest = jnp.maximum(1.0 - link.span**2 - slope**2, 0.0)
            mean = link.mean * first + self.ou * mean_sd * inner
            end = link.span * first + self.ou * (slope * inner + jnp.sqrt(rest) * outer)
            return end, mean

        start = self.ou * jax.random.normal(jax.random.fold_in(key, 1))
        _, means = jax.lax.scan(step, start, (links, draws.T))
        white = self.white * blocks.weight / jnp.sqrt(blocks.count) * draws[3]
        return blocks.scale * (means + white)

    def sample_sd(self, samples: Blocks) -> Array:
        """Return the square root of (white weight)^2 + ou^2 (N)."""
        return jnp.hypot(self.white * samples.weight, self.ou)


class Floor(AbstractGaussian):
    """Noise floor as measured, not fitted, in addition to what a model misses.

    By itself this is the noise without a discrepancy.

    white, ou, tau: As in `Correlated`; nan where they are the measured ones; factor: Factor by
    which both standard deviations exceed the measured ones; remainder: Size of the discrepancy (N):
    its standard deviation where the force is largest. ``factor`` and ``remainder`` are nan where
    the likelihood sums over them (`floorlikelihood`).
    """

    white: Constant
    ou: Constant
    tau: Constant
    factor: Constant
    remainder: Constant
    name: ClassVar[str] = "floor"
    units: ClassVar[dict[str, str]] = {
        "white": "force",
        "ou": "force",
        "tau": "time",
        "factor": "count",
        "remainder": "force",
    }
    meanings: ClassVar[dict[str, str]] = {
        **Correlated.meanings,
        "factor": "noise in the fit over noise measured at rest",
        "remainder": "what the model misses, one standard deviation",
    }
    words: ClassVar[str] = (
        "as measured at rest, without the model, and not fitted; what the model misses goes into a "
        "discrepancy of smooth functions and a rough part, whose size (noise.remainder) is summed "
        "over with a prior that costs"
    )

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the noise as measured, its discrepancy's size summed over; nothing is free."""
        return cls(*5 * [math.nan])

    @property
    def _alone(self) -> Correlated:
        return Correlated(self.factor * self.white, self.factor * self.ou, self.tau)

    def innovations(self, residual: Array, blocks: Blocks) -> tuple[Array, Array]:
        """Return the innovations of the correlated noise, and their variances."""
        return self._alone.innovations(residual, blocks)

    def draw(self, key: Array, blocks: Blocks) -> Array:
        """Return one realisation (B,) of the correlated noise."""
        return self._alone.draw(key, blocks)

    def sample_sd(self, samples: Blocks) -> Array:
        """Return the square root of (white weight)^2 + ou^2 (N)."""
        return self._alone.sample_sd(samples)


NOISES: dict[str, type[AbstractNoise]] = catalogue.loaded(catalogue.NOISES)
"""The noise models by name, the default first."""


def _motion_sd(blocks: Blocks) -> Array:
    """Return the sd (B,) in N that errors of the motion and of its times add."""
    return jnp.hypot(blocks.extra, blocks.timing)


class _Links(NamedTuple):
    """Dependence of a block of a unit-variance OU process on its first sample x, each (B,).

    ``gap`` is the decay from the previous block's last sample to x, ``span`` that from x to the
    last sample. ``mean`` is the regression of the block's mean on x, ``mean_variance`` the rest of
    the mean's variance, and ``shared`` the covariance of that rest with the last sample's.
    """

    gap: Array
    span: Array
    mean: Array
    mean_variance: Array
    shared: Array


def _links(blocks: Blocks, tau: Array) -> _Links:
    """Return closed forms for n samples h apart, with rho = e^{-h/tau}."""
    single = blocks.count < 2.0
    count = jnp.where(single, 2.0, blocks.count)
    length = jnp.where(single, 1.0, blocks.last - blocks.first)
    step = length / (count - 1.0) / tau
    before = jnp.concatenate([blocks.first[:1], blocks.last[:-1]])
    gap = jnp.exp(-jnp.maximum(blocks.first - before, 0.0) / tau)
    loss = -jnp.expm1(-step)
    rho = 1.0 - loss
    span = jnp.exp(-step * (count - 1.0))
    mean = -jnp.expm1(-step * count) / (count * loss)
    full = ((2.0 - loss) - 2.0 * rho * mean) / (count * loss)
    variance = jnp.maximum(full - mean**2, 0.0)
    return _Links(
        gap,
        jnp.where(single, 1.0, span),
        jnp.where(single, 1.0, mean),
        jnp.where(single, 0.0, variance),
        jnp.where(single, 0.0, mean * (1.0 - span)),
    )
