"""Name a model's constants (``m``, ``c[0]``, ``noise.white``), fill its fields, draw its priors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, Protocol, TypeGuard, TypeVar

import jax
import numpy as np

from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.priors.distributions import AbstractPrior, AbstractScalarPrior
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array

Part = TypeVar("Part")


def is_prior(node: object) -> TypeGuard[AbstractPrior]:
    """Return whether a field is free."""
    return isinstance(node, AbstractPrior)


@dataclass(frozen=True)
class Field:
    """Field of a model or noise: its name, value or prior, unit and shape.

    ``first_index`` is the index of the first member of a field that is a vector.
    """

    name: str
    value: Any
    unit: str
    shape: tuple[int, ...]
    first_index: int

    @property
    def names(self) -> tuple[str, ...]:
        """Return a name for each number: ``m``, or ``c[0]``, ``c[1]``, ..."""
        if not self.shape:
            return (self.name,)
        return tuple(f"{self.name}[{self.first_index + k}]" for k in range(self.shape[0]))


def fields_of(part: Pytree, prefix: str = "") -> Iterator[Field]:
    """Yield every number or prior in a module, depth first, in JAX's order of leaves."""
    prefix = prefix + getattr(part, "prefix", "")
    for field in fields(part):
        if field.metadata.get("static", False):
            continue
        value = getattr(part, field.name)
        if isinstance(value, tuple):
            for member in value:
                yield from fields_of(member, prefix)
            continue
        if isinstance(value, Pytree) and not isinstance(value, AbstractPrior):
            yield from fields_of(value, prefix)
            continue
        first = getattr(part, "first_index", {}).get(field.name, 0)
        unit = getattr(part, "units", {})[field.name]
        yield Field(prefix + field.name, value, unit, value_shape(value), first)


class Modelled(Protocol):
    """Object with a model and its noise: a posterior, or the parameters of a hypothesis."""

    @property
    def model(self) -> Model:
        """Return the model."""
        ...

    @property
    def noise(self) -> AbstractNoise:
        """Return the noise model."""
        ...


def all_fields(posterior: Modelled) -> list[Field]:
    """Return the fields of the model, then those of the noise."""
    return [*fields_of(posterior.model), *fields_of(posterior.noise)]


def names(posterior: Modelled) -> list[str]:
    """Return the names of ``posterior.constants``, in order."""
    return [name for field in all_fields(posterior) for name in field.names]


def unit_kinds(posterior: Modelled) -> list[str]:
    """Return the kind of unit of each of ``names``: stiffness, exponent, rate, force, and so on."""
    return [field.unit for field in all_fields(posterior) for _ in field.names]


NOT_SAMPLED = "measured at rest, or summed over a few values"  # by the likelihood


def described(fields: Iterable[Field]) -> dict[str, str]:
    """Return each field's prior as on the command line, or the value that it is fixed at."""
    return {field.name: _described(field.value) for field in fields}


def _described(value: Any) -> str:
    if is_prior(value):
        return value.describe()
    return NOT_SAMPLED if np.isnan(value).any() else f"fixed at {value}"


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
