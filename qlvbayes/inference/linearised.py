"""Predictions, likelihood and prior with their slopes: what a Gauss-Newton step needs.

Slopes are taken along given directions only, so that one compiled function serves every choice of
free constants.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.model.noise import AbstractGaussian
from qlvbayes.model.posterior import Posterior
from qlvbayes.model.record import Blocks, Record

# what LLVM's costly passes would gain in speed cannot be measured; they take a third of the time
compiled = partial(jax.jit, compiler_options={"xla_llvm_disable_expensive_passes": True})


class PriorTerms(NamedTuple):
    """At theta (D,): constants (P,), their slopes (P, D), and log prior with two derivatives.

    log_prior (L,): one entry a prior, in field order; gradient (D,); hessian (D, D).
    """

    constants: Array
    slopes: Array
    log_prior: Array
    gradient: Array
    hessian: Array


@compiled
def prior_terms(posterior: Posterior, theta: Array) -> PriorTerms:
    """Constants and priors at theta; no forward model is run."""

    def total(x: Array) -> Array:
        return jnp.sum(posterior.log_priors(x))

    slope = jax.jacfwd(total)
    return PriorTerms(
        posterior.constants(theta),
        jax.jacfwd(posterior.constants)(theta),
        posterior.log_priors(theta),
        slope(theta),
        jax.jacfwd(slope)(theta),
    )


@compiled
def predictions_along(
    posterior: Posterior, constants: Array, directions: Array
) -> tuple[Array, Array]:
    """Block means (T, B) of constants (P,), and their slopes (K, T, B) along directions (K, P)."""

    def predicted(x: Array) -> Array:
        return posterior.predict_with(posterior.with_constants(x)[0])

    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(predicted, (constants,), (direction,))

    return jax.vmap(along, out_axes=(None, 0))(directions)


class LikelihoodTerms(NamedTuple):
    """Per test: minus log likelihood (T,), its gradient (T, K) and information (T, K, K)."""

    loss: Array
    gradient: Array
    information: Array


@compiled
def likelihood_terms(
    noise: AbstractGaussian,
    noise_slopes: AbstractGaussian,
    record: Record,
    predicted: Array,
    slopes: Array,
) -> LikelihoodTerms:
    """Gaussian likelihood of predictions (T, B) with slopes (K, T, B).

    noise_slopes: the noise's constants along the same directions, each with a leading axis (K,).
    The information is Fisher's, from the slopes of innovations and of their log variances:
    sum e_i e_j / S + S_i S_j / (2 S^2).
    """

    def one(blocks: Blocks, predicted: Array, slopes: Array) -> tuple[Array, Array, Array]:
        def filtered(noise: AbstractGaussian, predicted: Array) -> tuple[Array, Array]:
            errors, variances = noise.innovations(blocks.force - predicted, blocks)
            return errors, jnp.log(variances)

        def along(noise_slope: AbstractGaussian, slope: Array) -> tuple:
            return jax.jvp(filtered, (noise, predicted), (noise_slope, slope))

        (errors, logs), (errors_along, logs_along) = jax.vmap(along, out_axes=(None, 0))(
            noise_slopes, slopes
        )
        inverse = jnp.exp(-logs)
        real = blocks.real
        loss = 0.5 * jnp.sum(jnp.where(real, errors**2 * inverse + logs + _LOG_2PI, 0.0))
        gradient = errors_along @ (errors * inverse)
        gradient += 0.5 * logs_along @ jnp.where(real, 1.0 - errors**2 * inverse, 0.0)
        information = (errors_along * inverse) @ errors_along.T
        information += 0.5 * logs_along @ logs_along.T
        return loss, gradient, information

    return LikelihoodTerms(*jax.vmap(one, (0, 0, 1))(record.blocks, predicted, slopes))


_LOG_2PI = 1.8378770664093453


@compiled
def whitened(noise: AbstractGaussian, record: Record, vectors: Array) -> Array:
    """Vectors (M, T, B) filtered to innovations over their sds: unit white noise if they are it."""

    def one(vector: Array) -> Array:
        errors, variances = jax.vmap(noise.innovations)(vector, record.blocks)
        return errors / jnp.sqrt(variances)

    return jax.vmap(one)(vectors)


@compiled
def force(posterior: Posterior, constants: Array) -> Array:
    """(T, B) block means of constants (P,)."""
    return posterior.predict_with(posterior.with_constants(constants)[0])
