"""What every relaxation offers. A new one is one class in one file."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.laws.scales import Scales


class AbstractRelaxation(eqx.Module):
    r"""The reduced relaxation function, of falling exponentials and no others.

    .. math:: g(t) = c_0 + \sum_i c_i e^{-v_i t}, \qquad c_i \ge 0, \quad \sum c = 1

    A field is a constant: a number, or a prior while it is free; a static field may say how many
    terms stand for a continuous spectrum, a number that no constant may change. ``name`` as after
    ``--relaxation``; ``units``, ``meanings``, ``law``, ``reference`` as of an elastic law. The
    creep function is the dual of g and follows from the same spectrum.
    """

    name: eqx.AbstractClassVar[str]
    units: eqx.AbstractClassVar[dict[str, str]]
    meanings: eqx.AbstractClassVar[dict[str, str]]
    law: eqx.AbstractClassVar[str]
    reference: eqx.AbstractClassVar[str]

    @classmethod
    @abstractmethod
    def default(cls, scales: Scales) -> Self:
        """The law with every constant free, under weakly informative priors at these scales."""

    @abstractmethod
    def spectrum(self) -> tuple[Array, Array]:
        """(k + 1,) fractions, the first of what never relaxes, and the (k,) rates (1/s).

        k is the same whatever the constants are; both are differentiable in them.
        """

    @abstractmethod
    def times(self) -> dict[str, Array]:
        """The times (s) that the constants stand for, by name: the tests should hold them."""

    def curve(self, time: Array) -> Array:
        """G at ``time`` (s), any shape, as the spectrum has it."""
        fractions, rates = self.spectrum()
        decays = jnp.exp(-jnp.asarray(time)[..., None] * rates)
        return fractions[0] + decays @ fractions[1:]


def decades_of(scales: Scales) -> int:
    """Decades of time that relaxation may take up.

    From a tenth of the sampling interval to ten times the longest phase, rounded up.
    """
    return math.ceil(math.log10(scales.longest / scales.shortest) - 1e-9) + 2


def middle_of(scales: Scales) -> tuple[float, float]:
    """Logarithm of the time in the middle of what the tests can tell, and the sd of a prior.

    The measurable range (the shortest interval to the longest phase) lies inside two sds.
    """
    middle = 0.5 * math.log(scales.shortest * scales.longest)
    return middle, max(math.log(scales.longest / scales.shortest) / 4.0, 1.0)


def shared_out(lasting: Array, weights: Array) -> Array:
    """(k + 1,) fractions: ``lasting`` and the rest, in the proportions of ``weights`` (k,)."""
    relaxing = (1.0 - lasting) * weights / jnp.sum(weights)
    return jnp.concatenate([jnp.reshape(jnp.asarray(lasting, dtype=float), (1,)), relaxing])
