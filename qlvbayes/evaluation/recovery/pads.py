"""Pads with one effect of several, drawn from the priors, tested on the bench, and fitted."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.evaluation.recovery.bench import bench
from qlvbayes.evaluation.recovery.clouds import Cloud
from qlvbayes.evaluation.recovery.humps import tops
from qlvbayes.evaluation.recovery.sampled import Sample, sample
from qlvbayes.fitting import compiled
from qlvbayes.inference import linearised
from qlvbayes.inference.gaussnewton import noise_along, predict_along
from qlvbayes.inference.subset import Ensemble, Subset, with_every_effect
from qlvbayes.model.posterior import Posterior, draw_priors, is_prior
from qlvbayes.priors import HalfNormal

_BETWEEN = 0.8  # sd that fills the gap between two slices of a shape


@dataclass(frozen=True, eq=False)
class Pads:
    """Pads with this effect; the others of the ensemble are at their nulls."""

    effect: AbstractEffect
    whole: Ensemble

    @cached_property
    def subset(self) -> Subset:
        """The plain constants, the noise and the effect."""
        return self.whole.subset((self.effect.name,))

    @cached_property
    def constants(self) -> dict[str, int]:
        """The effect's free constants: their names and their places among all."""
        fields = self.whole.fields(self.effect.name)
        places = [k for field in fields if field.theta for k in field.constants]
        return {self.whole.names[k].partition(".")[2]: k for k in places}

    @cached_property
    def _alone(self) -> Posterior:
        """Without the other effects, whose draws would otherwise shift this one's."""
        return with_every_effect(bench().posterior, (self.effect,)).posterior

    @cached_property
    def _linear(self) -> np.ndarray:
        """(F,) whether a free number is the logarithm of a half-normal one."""
        whole = self.whole.posterior
        leaves = jax.tree.leaves((whole.model, whole.noise), is_leaf=is_prior)
        found = [np.full(x.size, isinstance(x, HalfNormal)) for x in leaves if is_prior(x)]
        return np.concatenate(found)[self.subset.theta]

    def recovered(
        self, seed: int, k: int, shares: tuple[float, ...]
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Of one pad: truth (C,), posterior quantiles (len(shares), C), effective draws ()."""
        rng = np.random.default_rng([seed, zlib.crc32(self.effect.name.encode()), k])
        theta = self._whole(draw_priors(self._alone, 1, rng)[0])
        terms = linearised.prior_terms(self.whole.posterior, theta)
        constants = self.subset.nulled(np.asarray(terms.constants))
        found = self._fitted(self._tested(constants, rng), rng)
        return constants[list(self.constants.values())], found.quantiles(shares), found.worth

    def _whole(self, free: np.ndarray) -> np.ndarray:
        """Theta (..., D) of the whole from the free numbers (..., F)."""
        found = np.tile(self.whole.centre, (*free.shape[:-1], 1))
        found[..., self.subset.theta] = free
        return found

    def _tested(self, constants: np.ndarray, rng: np.random.Generator) -> Ensemble:
        """The ensemble with the forces that a pad with these constants and noise gives."""
        posterior = self.whole.posterior
        at_rest = np.zeros((1, constants.size))
        forces, _ = predict_along(self.whole, constants, at_rest)
        noise, _ = noise_along(posterior.noise, constants, at_rest)
        blocks = posterior.record.blocks
        key = jax.random.key(int(rng.integers(2**31)))
        errors = np.asarray(compiled.noise_draws(noise, blocks, key[None])[0])
        record = replace(posterior.record, blocks=replace(blocks, force=forces + errors))
        return self.whole.with_record(record)

    def _fitted(self, tested: Ensemble, rng: np.random.Generator) -> Sample:
        """Climb to the tops and sample about them."""
        free, places = self.subset.theta, list(self.constants.values())

        def judge(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            logs, constants = _judged(tested.posterior, self._whole(numbers), self.subset.null)
            total = np.asarray(logs)[:, [*self.subset.priors, -1]].sum(axis=1)
            return np.where(np.isfinite(total), total, -np.inf), np.asarray(constants)[:, places]

        found, slices = tops(tested, self.subset, self.effect.name)
        clouds = [
            Cloud.about(top.theta[free], top.covariance, linear)
            for top in found
            for linear in (self._linear, np.zeros_like(self._linear))
        ]
        for one in slices:
            covariance = np.eye(free.size) * _BETWEEN**2
            covariance[np.ix_(~one.held, ~one.held)] = one.top.covariance
            clouds.append(Cloud.about(one.top.theta[free], covariance, self._linear))
        return sample(judge, clouds, rng)


@jax.jit
def _judged(posterior: Posterior, thetas: Array, null: Array) -> tuple[Array, Array]:
    """(N, L + 1) log priors and, last, log likelihood; (N, P) constants, at null (P,) if off."""

    def one(theta: Array) -> tuple[Array, Array]:
        constants = jnp.where(jnp.isnan(null), posterior.constants(theta), null)
        model, noise = posterior.with_constants(constants)
        blocks = posterior.record.blocks
        residuals = blocks.force - posterior.predict_with(model)
        likelihood = jnp.sum(jax.vmap(noise.log_likelihoods)(residuals, blocks))
        return jnp.append(posterior.log_priors(theta), likelihood), constants

    return jax.vmap(one)(thetas)
