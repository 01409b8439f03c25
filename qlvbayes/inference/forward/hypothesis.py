"""A hypothesis about one specimen, and the numbers that it leaves free: a base law and effects."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Array as JaxArray
from numpy.typing import NDArray

from qlvbayes.model.parameters import names
from qlvbayes.model.posterior import Posterior, is_prior, value_shape
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.priors.natural import AbstractDirect

Array = NDArray[np.float64]

ELASTIC, RELAXATION = "elastic", "relaxation"
"""The parts of a model beside its effects."""
_LEAST = 16  # rows of constants that are computed at once: what has few takes no time


@dataclass(frozen=True)
class Hypothesis:
    """An elastic law, a relaxation and a set of effects, by name."""

    elastic: str
    relaxation: str
    effects: frozenset[str] = frozenset()

    @property
    def base(self) -> tuple[str, str]:
        """Its laws."""
        return self.elastic, self.relaxation

    def plus(self, effect: str) -> Hypothesis:
        """With one more effect."""
        return replace(self, effects=self.effects | {effect})

    def less(self, effect: str) -> Hypothesis:
        """Without one of its effects."""
        return replace(self, effects=self.effects - {effect})


@dataclass(frozen=True, eq=False)
class Leaf:
    """One field: its prior, its places in theta, and in a hypothesis's constants."""

    prior: AbstractPrior
    theta: range
    constants: range

    @cached_property
    def flat(self) -> tuple[Any, tuple[Array, ...]]:
        """The prior's structure and numbers: JAX takes them faster than the prior itself."""
        numbers, structure = jax.tree.flatten(self.prior)
        return structure, tuple(np.asarray(number, dtype=float) for number in numbers)

    def values(self, thetas: Array) -> Array:
        """(K, ...) values of rows of all free numbers (K, F)."""
        own = thetas[:, self.theta.start : self.theta.stop]
        return np.asarray(_value(*self.flat, few_sizes(own)))[: len(thetas)]


@dataclass(frozen=True, eq=False)
class Direct:
    """The free numbers whose priors are quadratic in them, all at once.

    theta, constants (Q,): their places in theta and in the constants; in_log (Q,): which are
    logarithms; mean, precision, curvature (Q,); top: sum of the log densities' tops.
    """

    theta: NDArray[np.intp]
    constants: NDArray[np.intp]
    in_log: NDArray[np.bool_]
    mean: Array
    precision: Array
    curvature: Array
    top: float

    @classmethod
    def of(cls, leaves: Iterable[Leaf]) -> Direct:
        """Of those among some fields that have such a prior."""
        pairs = [(leaf, p) for leaf in leaves if isinstance(p := leaf.prior, AbstractDirect)]
        densities = [prior.density() for _, prior in pairs]
        return cls(
            np.array([leaf.theta.start for leaf, _ in pairs], dtype=np.intp),
            np.array([leaf.constants.start for leaf, _ in pairs], dtype=np.intp),
            np.array([prior.in_log for _, prior in pairs], dtype=bool),
            np.array([one.mean for one in densities]),
            np.array([one.precision for one in densities]),
            np.array([one.curvature for one in densities]),
            sum(one.top for one in densities),
        )

    def values(self, thetas: Array) -> Array:
        """(K, Q) constants of thetas (K, F)."""
        own = thetas[:, self.theta]
        own[:, self.in_log] = np.exp(own[:, self.in_log])
        return own


@dataclass(frozen=True, eq=False)
class Parameters:
    """What a hypothesis leaves free: F numbers theta, P constants in the order of ``names``.

    lowest, highest, length (F,): bounds and natural length of each free number; fixed (P,):
    constants that are not free, nan elsewhere; direct: numbers whose prior is quadratic in them;
    joint: the other fields.
    """

    hypothesis: Hypothesis
    posterior: Posterior
    leaves: tuple[Leaf, ...]
    lowest: Array
    highest: Array
    length: Array
    fixed: Array
    direct: Direct
    joint: tuple[Leaf, ...]

    @classmethod
    def of(cls, hypothesis: Hypothesis, posterior: Posterior) -> Parameters:
        """Of a posterior whose noise is fixed."""
        leaves: list[Leaf] = []
        fixed, bounds = [np.zeros(0)], [np.zeros((0, 3))]
        theta = constants = 0
        for leaf in jax.tree.leaves((posterior.model, posterior.noise), is_leaf=is_prior):
            if not is_prior(leaf):
                fixed.append(np.ravel(leaf))
                constants += fixed[-1].size
                continue
            count = int(np.prod(value_shape(leaf), dtype=int))
            places = range(theta, theta + leaf.size), range(constants, constants + count)
            leaves.append(Leaf(leaf, *places))
            bounds.append(np.tile(_bounds(leaf), (leaf.size, 1)))
            fixed.append(np.full(count, np.nan))
            theta, constants = theta + leaf.size, constants + count
        low, high, length = np.concatenate(bounds).T.copy()
        joint = tuple(leaf for leaf in leaves if not isinstance(leaf.prior, AbstractDirect))
        known = np.concatenate(fixed), Direct.of(leaves), joint
        return cls(hypothesis, posterior, tuple(leaves), low, high, length, *known)

    def within(self, thetas: Array) -> Array:
        """Thetas (..., F) brought back to the bounds that they are beyond."""
        return np.clip(thetas, self.lowest, self.highest)

    @property
    def size(self) -> int:
        """F."""
        return self.lowest.size

    @cached_property
    def names(self) -> list[str]:
        """Of the P constants."""
        return names(self.posterior)

    @cached_property
    def by_name(self) -> dict[str, Leaf]:
        """Fields by the name of their first constant, in the order of theta."""
        return {self.names[leaf.constants.start]: leaf for leaf in self.leaves}

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Where in the P constants those of each law and effect are."""
        model = self.posterior.model
        parts = {ELASTIC: model.elastic, RELAXATION: model.relaxation}
        parts |= {effect.name: effect for effect in model.effects}
        found, start = {}, 0
        for name, part in parts.items():
            shapes = map(value_shape, jax.tree.leaves(part, is_leaf=is_prior))
            stop = start + sum(math.prod(shape) for shape in shapes)
            found[name] = slice(start, stop)
            start = stop
        return found

    def carried(self, fewer: Parameters) -> list[int]:
        """Where in theta the numbers are of a hypothesis that leaves no others free."""
        return [place for name in fewer.by_name for place in self.by_name[name].theta]

    def constants(self, thetas: Array) -> Array:
        """(K, P) constants of thetas (K, F)."""
        found = np.tile(self.fixed, (len(thetas), 1))
        found[:, self.direct.constants] = self.direct.values(thetas)
        for leaf in self.joint:
            here = slice(leaf.constants.start, leaf.constants.stop)
            found[:, here] = leaf.values(thetas).reshape(len(thetas), -1)
        return found


def _bounds(prior: AbstractPrior) -> tuple[float, float, float]:
    """Least and largest of a prior's numbers, and their natural length."""
    if isinstance(prior, AbstractDirect):
        return prior.density()[:3]
    return -math.inf, math.inf, 1.0


def few_sizes(rows: Array) -> Array:
    """Rows (K, ...) and the first of them again, up to 16, 64, 256 ...: few sizes are compiled."""
    size = _LEAST
    while size < len(rows):
        size *= 4
    return filled_up(rows, size)


def filled_up(rows: Array, multiple: int) -> Array:
    """Rows (K, ...) and the first of them again, up to a multiple."""
    return np.concatenate([rows, np.repeat(rows[:1], -len(rows) % multiple, axis=0)])


@partial(jax.jit, static_argnums=0)
def _value(structure: Any, prior: tuple[Array, ...], numbers: JaxArray) -> JaxArray:
    """(K, ...) values of numbers (K, size), by a flattened prior."""
    whole: AbstractPrior = jax.tree.unflatten(structure, prior)
    return jax.vmap(lambda x: whole.constrain(x)[0])(numbers)
