r"""Compute what one step adds to a relaxing mode, by moments of a decaying exponential.

.. math:: M_n(a) = \int_0^1 s^n e^{-a (1 - s)} ds, \quad M_n = \frac{1 - n M_{n-1}}{a}, \quad
          M_0 = \frac{1 - e^{-a}}{a}
"""

from __future__ import annotations

from itertools import zip_longest
from typing import NamedTuple, Self

from qlvbayes import xp
from qlvbayes.laws.smoothmath import exp_difference_ratio
from qlvbayes.xp import Array

_NEAR = 0.3  # decay below which a series of 13 terms is exact to 1e-15, and above which division is
_TERMS = 13


def moments(decay: Array, count: int) -> list[Array]:
    """Return the moments M_0, M_1, ..., ``count`` of them, each of the shape of ``decay``."""
    near = decay < _NEAR
    close = xp.where(near, decay, 0.0)
    last = xp.full_like(close, 1.0 / (count + _TERMS))
    for k in range(count + _TERMS - 1, count - 1, -1):
        last = (1.0 - close * last) * (1.0 / k)
    by_series = [last]
    for n in range(count - 1, 0, -1):
        by_series.insert(0, (1.0 - close * by_series[0]) * (1.0 / n))
    inverse = 1.0 / xp.where(near, 1.0, decay)
    by_division = [(1.0 - xp.exp(-decay)) * inverse]
    for n in range(1, count):
        by_division.append((1.0 - n * by_division[-1]) * inverse)
    return [xp.where(near, *both) for both in zip(by_series, by_division, strict=True)]


class Rise(NamedTuple):
    """Rise of an elastic force F along a step, s from 0 to 1; arrays of any one shape, in N.

    dF/ds = sum_j powers[j] s^j + begun e^{grown s}, where ended is begun e^grown.
    """

    powers: tuple[Array, ...]  # at most three
    exponential: tuple[Array, Array, Array] | None = None  # grown, begun, ended

    @classmethod
    def through(cls, f0: Array, fm: Array, f1: Array) -> Self:
        """Return the rise of the parabola through F at the start, the middle and the end."""
        return cls((4.0 * fm - 3.0 * f0 - f1, 4.0 * (f0 + f1 - 2.0 * fm)))

    def plus(self, *powers: Array) -> Self:
        """Return the rise with coefficients added to the powers of s."""
        pairs = zip_longest(self.powers, powers, fillvalue=0.0)
        return self._replace(powers=tuple(own + more for own, more in pairs))

    def relaxed(self, decay: Array) -> Array:
        """Return the integral of e^{-decay (1 - s)} dF/ds over s from 0 to 1."""
        total: Array = 0.0
        if self.powers:
            pairs = zip(self.powers, moments(decay, len(self.powers)), strict=True)
            for power, moment in pairs:
                total = total + power * moment
        if self.exponential is not None:
            grown, begun, ended = self.exponential
            total = total + exp_difference_ratio(ended, begun * xp.exp(-decay), grown + decay)
        return total
