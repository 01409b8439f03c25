"""Define the interface of relaxation laws, and name times that are not resolved."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.io.wording import plain
from qlvbayes.laws.scales import Scales
from qlvbayes.pytree import Pytree
from qlvbayes.xp import Array

MOST_TERMS = 60
"""Largest number of exponentials of a law: the time that a force takes grows with it."""


class AbstractRelaxation(Pytree):
    r"""Relaxation law: the reduced relaxation function, a sum of falling exponentials.

    .. math:: g(t) = c_0 + \sum_i c_i e^{-v_i t}, \qquad c_i \ge 0, \quad \sum c = 1

    Each field is a constant of the law: a number where it is fixed, a prior where it is free. A
    static field may give the number of terms that approximate a continuous spectrum; no constant
    may change it. ``name`` follows ``--relaxation``; ``units``, ``meanings``, ``law`` and
    ``reference`` are those of an elastic law. The creep function is the dual of g and follows from
    the same spectrum.
    """

    name: ClassVar[str]
    units: ClassVar[dict[str, str]]
    meanings: ClassVar[dict[str, str]]
    law: ClassVar[str]
    reference: ClassVar[str]

    @classmethod
    @abstractmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law with every constant free, under weak priors at these scales."""

    @abstractmethod
    def spectrum(self) -> tuple[Array, Array]:
        """Return the fractions and the rates of the exponentials; both are differentiable.

        The first of the fractions (k + 1,) is the share that never relaxes; the rates (k,) are in
        1/s. The number k does not depend on the constants, and is at most `MOST_TERMS`.
        """

    @abstractmethod
    def times(self) -> dict[str, Array]:
        """Return the times (s) that the constants stand for, by name.

        The tests should cover them: a notice names those that they do not.
        """

    def curve(self, time: Array) -> Array:
        """Return g at ``time`` (s), an array of any shape, as the spectrum gives it."""
        fractions, rates = self.spectrum()
        decays = xp.exp(-xp.asarray(time)[..., None] * rates)
        return fractions[0] + decays @ fractions[1:]


def decades_of(scales: Scales) -> int:
    """Return over how many decades of time relaxation may extend."""
    return math.ceil(math.log10(scales.longest / scales.shortest) - 1e-9) + 2


def middle_of(scales: Scales) -> tuple[float, float]:
    """Return the logarithm of the middle of the measurable times (s), and the sd of its prior."""
    middle = 0.5 * math.log(scales.shortest * scales.longest)
    return middle, max(math.log(scales.longest / scales.shortest) / 4.0, 1.0)


def shared_out(lasting: Array, weights: Array) -> Array:
    """Return (k + 1,) fractions: ``lasting``, and the rest in proportion to ``weights`` (k,)."""
    relaxing = (1.0 - lasting) * weights / xp.sum(weights)
    return xp.concatenate([xp.asarray(lasting)[None], relaxing])


def unresolved_times(relaxation: AbstractRelaxation, scales: Scales) -> Iterator[str]:
    """Yield a sentence for each time below the sampling interval or beyond the longest phase."""
    for name, time in relaxation.times().items():
        value = float(np.asarray(time))
        if value < scales.shortest:
            yield (
                f"the relaxation time {name} is about {plain(value, 2)} s, below the sampling "
                f"interval of {plain(scales.shortest, 2)} s: its prior says more of it than the "
                "tests"
            )
        if value > scales.longest:
            yield (
                f"the relaxation time {name} is about {plain(value, 2)} s, beyond the longest hold "
                f"of {plain(scales.longest, 2)} s: its prior says more of it than the tests"
            )
