"""Compute the posterior density over a flat vector of free parameters."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, TypeGuard, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes.model.floorlikelihood import FloorLikelihood
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.motion.record import Record
from qlvbayes.priors.distributions import AbstractPrior, AbstractScalarPrior
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array

Part = TypeVar("Part")


def is_prior(node: object) -> TypeGuard[AbstractPrior]:
    """Return whether a field is free."""
    return isinstance(node, AbstractPrior)


class Posterior(Pytree):
    """Posterior density, prior times likelihood, of some tests of one specimen.

    ``model`` and ``noise`` hold priors where they are free. ``record`` holds the tests along a
    leading axis. ``floor`` is the record's likelihood under measured noise, where the noise's
    constants are summed over. The flat vector theta (D,) holds the free constants' unconstrained
    numbers in field order.
    """

    model: Model
    noise: AbstractNoise
    record: Record
    floor: FloorLikelihood | None

    def __init__(
        self,
        model: Model,
        noise: AbstractNoise,
        record: Record,
        floor: FloorLikelihood | None = None,
    ) -> None:
        # arrays throughout, so that pads of one shape share one compiled function
        as_arrays = lambda tree: jax.tree.map(jnp.asarray, tree)  # noqa: E731
        self.model, self.noise, self.record, self.floor = map(
            as_arrays, (model, noise, record, floor)
        )

    @property
    def size(self) -> int:
        """Return D, the number of free parameters."""
        leaves = jax.tree.leaves((self.model, self.noise), is_leaf=is_prior)
        return sum(leaf.size for leaf in leaves if is_prior(leaf))

    def bind(self, theta: Array) -> tuple[Model, AbstractNoise, Array]:
        """Return model and noise with numbers for priors, and the log prior density over theta."""
        (model, noise), log_priors = self._bound(theta)
        return model, noise, jnp.sum(log_priors)

    def log_priors(self, theta: Array) -> Array:
        """Return (L,) log densities of each prior over its part of theta, in field order."""
        return self._bound(theta)[1]

    def _bound(self, theta: Array) -> tuple[tuple[Model, AbstractNoise], Array]:
        leaves, shape = jax.tree.flatten((self.model, self.noise), is_leaf=is_prior)
        bound, log_priors, taken = [], [jnp.zeros(0)], 0
        for leaf in leaves:
            value = leaf
            if is_prior(leaf):
                value, log_density = leaf.constrain(theta[taken : taken + leaf.size])
                log_priors.append(jnp.reshape(log_density, (1,)))
                taken += leaf.size
            bound.append(value)
        return jax.tree.unflatten(shape, bound), jnp.concatenate(log_priors)

    def predict(self, theta: Array) -> Array:
        """Return block means (T, B) of the force (N)."""
        model, _, _ = self.bind(theta)
        return self.predict_with(model)

    def predict_with(self, model: Model) -> Array:
        """Return block means (T, B) of the force (N) of a model whose constants are numbers."""
        return jax.vmap(lambda record: record.average(model.force(record.motion)))(self.record)

    def log_likelihood(self, theta: Array) -> Array:
        """Return the log density of all block means."""
        model, noise, _ = self.bind(theta)
        return self._log_likelihood(model, noise)

    def _log_likelihood(self, model: Model, noise: AbstractNoise) -> Array:
        residuals = self.record.blocks.force - self.predict_with(model)
        if self.floor is not None:
            return self.floor.log_likelihood(residuals)
        return jnp.sum(jax.vmap(noise.log_likelihoods)(residuals, self.record.blocks))

    def log_density(self, theta: Array) -> Array:
        """Return the log of prior density over theta times likelihood."""
        model, noise, log_prior = self.bind(theta)
        total = log_prior + self._log_likelihood(model, noise)
        return jnp.where(jnp.isnan(total), -jnp.inf, total)

    def constants(self, theta: Array) -> Array:
        """Return every constant (P,), fixed ones too, in the order of ``names``."""
        model, noise, _ = self.bind(theta)
        return jnp.concatenate([jnp.atleast_1d(x) for x in jax.tree.leaves((model, noise))])

    def drawn_constants(self, theta: Array, share: Array) -> Array:
        """Return the constants (P,) with those that the likelihood sums over drawn."""
        constants = self.constants(theta)
        if self.floor is None:
            return constants
        own = self.floor.drawn(self.record.blocks.force - self.predict(theta), share)
        return jnp.concatenate([constants[: -own.size], own])

    def with_constants(self, constants: Array) -> tuple[Model, AbstractNoise]:
        """Return model and noise whose numbers are ``constants`` (P,), ordered as ``names``."""
        model, noise = filled((self.model, self.noise), constants)
        return model, noise

    def unconstrain(self, constants: np.ndarray) -> np.ndarray:
        """Return theta (D,) of constants (P,) in the order of ``names``."""
        parts, taken = [np.zeros(0)], 0
        for leaf in jax.tree.leaves((self.model, self.noise), is_leaf=is_prior):
            shape = value_shape(leaf)
            count = int(np.prod(shape, dtype=int))
            value = np.reshape(constants[taken : taken + count], shape)
            taken += count
            if is_prior(leaf):
                parts.append(np.asarray(leaf.unconstrain(value)))
        return np.concatenate(parts)


def filled(part: Part, constants: Array) -> Part:
    """Return a part of a model whose fields are the numbers ``constants`` (P, ...), in order.

    Where there are K sets of constants, (P, K), each field has them along its last axis.
    """
    leaves, structure = jax.tree.flatten(part, is_leaf=is_prior)
    fields, taken = [], 0
    for leaf in leaves:
        shape = value_shape(leaf)
        count = math.prod(shape)
        rows = constants[taken : taken + count]
        fields.append(rows.reshape(shape + rows.shape[1:]))
        taken += count
    whole: Part = jax.tree.unflatten(structure, fields)
    return whole


def value_shape(field: Any) -> tuple[int, ...]:
    """Return the shape of the number or numbers that a field stands for."""
    if isinstance(field, AbstractScalarPrior):
        return ()
    if isinstance(field, AbstractPrior):
        leaves, structure = jax.tree.flatten(field)
        return _constrained_shape(structure, tuple(map(np.shape, leaves)), field.size)
    return np.shape(field)


@cache  # called often
def _constrained_shape(structure: Any, shapes: tuple, size: int) -> tuple[int, ...]:
    prior = jax.tree.unflatten(structure, [np.ones(shape) for shape in shapes])
    return np.shape(prior.constrain(np.zeros(size))[0])


def draw_priors(part: Pytree, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return (count, D) unconstrained numbers drawn from the priors of a module."""
    priors = [leaf for leaf in jax.tree.leaves(part, is_leaf=is_prior) if is_prior(leaf)]
    values = [[prior.draw(rng) for prior in priors] for _ in range(count)]
    columns = [
        unconstrained(prior, np.stack(drawn))
        for prior, drawn in zip(priors, zip(*values, strict=True), strict=True)
    ]
    return np.concatenate([np.zeros((count, 0)), *columns], axis=1)


def unconstrained(prior: AbstractPrior, values: np.ndarray) -> np.ndarray:
    """Return the unconstrained numbers (K, size) of K values (K, ...) of a prior's constants."""
    with np.errstate(divide="ignore"):
        return np.asarray(prior.unconstrain(np.moveaxis(values, 0, -1))).T


def central(part: Pytree, draws: int = 50) -> np.ndarray:
    """Return the median (D,) of the priors' unconstrained numbers; it is the same at every call."""
    return np.median(draw_priors(part, draws, np.random.default_rng(0)), axis=0)
