"""Define a hypothesis about one specimen (a base law and effects) and its free parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise
from qlvbayes.model.parameters import filled, is_prior, names, value_shape
from qlvbayes.priors.distributions import (
    AbstractPrior,
    AbstractScalarPrior,
    HalfNormal,
    SignedAmplitude,
)

ELASTIC, RELAXATION = "elastic", "relaxation"
"""The names of a model's parts other than effects."""


@dataclass(frozen=True)
class Hypothesis:
    """An elastic law, a relaxation and a set of effects, by name."""

    elastic: str
    relaxation: str
    effects: frozenset[str] = frozenset()

    @property
    def base(self) -> tuple[str, str]:
        """Return the names of its laws."""
        return self.elastic, self.relaxation

    def plus(self, effect: str) -> Hypothesis:
        """Return the hypothesis with one more effect."""
        return replace(self, effects=self.effects | {effect})

    def less(self, effect: str) -> Hypothesis:
        """Return the hypothesis without one of its effects."""
        return replace(self, effects=self.effects - {effect})


@dataclass(frozen=True, eq=False)
class Leaf:
    """A free field of a model: its prior, its indices in theta and in the constants."""

    prior: AbstractPrior
    theta: range
    constants: range


class Amplitude(NamedTuple):
    """The parameter with which an effect's force grows."""

    number: int  # its index in theta
    constant: int  # its index in the constants
    prior: SignedAmplitude | HalfNormal

    @property
    def sd(self) -> float:
        """Return the standard deviation of the prior, for a half-normal before it is folded."""
        return float(self.prior.sd)


@dataclass(frozen=True, eq=False)
class Direct:
    """The free parameters whose priors are quadratic in them, as arrays."""

    # theta, constants (Q,): their indices in theta and in the constants
    theta: NDArray[np.intp]
    constants: NDArray[np.intp]
    in_log: NDArray[np.bool_]  # (Q,): which of them are logarithms
    shift: Array  # shift, scale (Q,): of the others' constants
    scale: Array
    # mean, precision, curvature (Q,): of the priors
    mean: Array
    precision: Array
    curvature: Array
    top: float  # sum of the maxima of the log densities

    @classmethod
    def from_leaves(cls, leaves: Iterable[Leaf]) -> Direct:
        """Return those parameters among some fields that have such a prior."""
        pairs = [(leaf, p) for leaf in leaves if isinstance(p := leaf.prior, AbstractScalarPrior)]
        densities = [prior.density() for _, prior in pairs]
        shift, scale = np.array([prior.affine for _, prior in pairs], float).reshape(-1, 2).T
        return cls(
            np.array([leaf.theta.start for leaf, _ in pairs], dtype=np.intp),
            np.array([leaf.constants.start for leaf, _ in pairs], dtype=np.intp),
            np.array([prior.in_log for _, prior in pairs], dtype=bool),
            shift,
            scale,
            np.array([one.mean for one in densities]),
            np.array([one.precision for one in densities]),
            np.array([one.curvature for one in densities]),
            sum(one.top for one in densities),
        )

    def values(self, thetas: Array) -> Array:
        """Return constants (K, Q) at thetas (K, F)."""
        selected = thetas[:, self.theta]
        values = self.shift + self.scale * selected
        values[:, self.in_log] = np.exp(selected[:, self.in_log])
        return values

    def log_densities(self, thetas: Array) -> Array:
        """Return the sum of the log densities (K,) at thetas (K, F), within the bounds."""
        offset = thetas[:, self.theta] - self.mean
        return np.asarray(self.top - 0.5 * (self.precision * offset**2).sum(axis=1))


@dataclass(frozen=True, eq=False)
class Parameters:
    """The free parameters theta (F,) of a hypothesis, and its constants (P,)."""

    hypothesis: Hypothesis
    model: Model  # with priors where its fields are free
    noise: AbstractNoise  # with fixed constants
    leaves: tuple[Leaf, ...]  # all free fields
    # lowest, highest, length (F,): bounds and natural length of each parameter
    lowest: Array
    highest: Array
    length: Array
    fixed: Array  # (P,): constants that are not free, NaN elsewhere
    direct: Direct  # parameters whose prior is quadratic in them
    joint: tuple[Leaf, ...]  # the other fields

    @classmethod
    def from_model(cls, hypothesis: Hypothesis, model: Model, noise: AbstractNoise) -> Parameters:
        """Return the parameters of a model, under noise whose constants are fixed."""
        leaves: list[Leaf] = []
        fixed, bounds = [np.zeros(0)], [np.zeros((0, 3))]
        theta = constants = 0
        for leaf in jax.tree.leaves((model, noise), is_leaf=is_prior):
            if not is_prior(leaf):
                fixed.append(np.ravel(leaf))
                constants += fixed[-1].size
                continue
            count = math.prod(value_shape(leaf))
            indices = range(theta, theta + leaf.size), range(constants, constants + count)
            leaves.append(Leaf(leaf, *indices))
            bounds.append(np.tile(_bounds(leaf), (leaf.size, 1)))
            fixed.append(np.full(count, np.nan))
            theta, constants = theta + leaf.size, constants + count
        low, high, length = np.concatenate(bounds).T.copy()
        joint = tuple(leaf for leaf in leaves if not isinstance(leaf.prior, AbstractScalarPrior))
        rest = np.concatenate(fixed), Direct.from_leaves(leaves), joint
        return cls(hypothesis, model, noise, tuple(leaves), low, high, length, *rest)

    def within(self, thetas: Array) -> Array:
        """Return thetas (..., F) clipped to the bounds."""
        return np.clip(thetas, self.lowest, self.highest)

    @property
    def size(self) -> int:
        """Return F, the number of free parameters."""
        return self.lowest.size

    @cached_property
    def names(self) -> list[str]:
        """Return the names of the P constants."""
        return names(self)

    @cached_property
    def by_name(self) -> dict[str, Leaf]:
        """Return the fields by the name of their first constant, in the order of theta."""
        return {self.names[leaf.constants.start]: leaf for leaf in self.leaves}

    @cached_property
    def amplitude_of(self) -> dict[str, Amplitude]:
        """Return the amplitude of each effect that has one, by the effect's name.

        It is the first constant at whose null value the effect vanishes, where its prior is normal
        or half-normal (`in_natural_amplitude`).
        """
        found = {}
        for effect in self.model.effects:
            leaf = self.by_name.get(f"{effect.name}.{next(iter(effect.null))}")
            if leaf is not None and isinstance(leaf.prior, SignedAmplitude | HalfNormal):
                numbers = leaf.theta.start, leaf.constants.start
                found[effect.name] = Amplitude(*numbers, leaf.prior)
        return found

    @cached_property
    def amplitudes(self) -> list[int]:
        """Return the indices in theta of the effects' amplitudes."""
        return [one.number for one in self.amplitude_of.values()]

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Return the slice of the P constants that each law and effect takes, by name."""
        model = self.model
        parts = {ELASTIC: model.elastic, RELAXATION: model.relaxation}
        parts |= {effect.name: effect for effect in model.effects}
        columns, start = {}, 0
        for name, part in parts.items():
            shapes = map(value_shape, jax.tree.leaves(part, is_leaf=is_prior))
            first, start = start, start + sum(math.prod(shape) for shape in shapes)
            columns[name] = slice(first, start)
        return columns

    def positions_of(self, fewer: Parameters) -> list[int]:
        """Return the indices in theta of the parameters of a hypothesis that has fewer of them."""
        return [index for name in fewer.by_name for index in self.by_name[name].theta]

    def constants(self, thetas: Array) -> Array:
        """Return the constants (K, P) at thetas (K, F)."""
        return self.bound(thetas)[0]

    def bound(self, thetas: Array) -> tuple[Array, Array]:
        """Return the constants (K, P) at thetas (K, F), and log prior densities (K,) over these."""
        values = np.tile(self.fixed, (len(thetas), 1))
        with np.errstate(all="ignore"):  # what is not finite is refused with its force
            values[:, self.direct.constants] = self.direct.values(thetas)
            logs = self.direct.log_densities(thetas)
            for leaf in self.joint:
                own, log = leaf.prior.constrain(thetas[:, leaf.theta].T)
                values[:, leaf.constants] = np.reshape(own, (-1, len(thetas))).T
                logs = logs + np.asarray(log)
        return values, logs

    def model_at(self, constants: Array) -> Model:
        """Return the model whose fields are the constants (P,)."""
        return filled(self.model, constants)


def _bounds(prior: AbstractPrior) -> tuple[float, float, float]:
    """Return lower bound, upper bound and natural length of a prior's parameters."""
    if isinstance(prior, AbstractScalarPrior):
        return prior.density()[:3]
    return -math.inf, math.inf, 1.0
