r"""Approximate any relaxation by a sum of exponentials of fixed rates, with few modes.

A continuous relaxation has some fifty modes, which over the times of one record are far from
independent: to a few parts in 1e5, the functions e^{-v t} of all rates v are spanned by three per
decade. The least-squares problem over times t_k (weights W_k)

.. math:: \min_w \sum_k W_k^2 \left(g(t_k) - w_0 - \sum_j w_j e^{-v_j t_k}\right)^2

is linear in g, so that w = M g with one matrix M for each record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from qlvbayes.io.arrays import Array

_A_DECADE = 3  # rates per decade: they leave 2e-5 of g(0), two would leave 5e-4
_BEFORE = 10.0  # the densest rates begin at the shortest step over this, as ramps resolve it
_FASTER = (10.0, 100.0)  # times that rate, for what relaxes within a step
_BEYOND = 3.0  # times the longest time: slower relaxation looks like a straight line
_TIMES = 8  # times per decade at which g is fitted
_AT_ONCE = 30.0  # weight of g(0), to which every force is proportional
_WITHIN = 0.1  # weight of times that no step resolves
_SHORTEST = 0.05  # quantile of the steps that counts as the shortest: a few may be rounding
_ROUNDED = 4.0  # the ends of the rates lie on quarters of a decade, so that records share them
_MULTIPLE = 8  # the number of modes is a multiple of this, so that few sizes are compiled


@dataclass(frozen=True, eq=False)
class FixedRates:
    """A set of fixed rates with the matrix that fits fractions to a relaxation function g."""

    rates: Array  # (L,): in 1/s
    times: Array  # (N,): in s
    matrix: Array  # (L + 1, N): takes g at those times to fractions

    @classmethod
    def over(cls, time: Array) -> Self:
        """Return the rates for motions whose grids of times (..., N) are given, in s."""
        steps = np.diff(time, axis=-1)
        shortest = float(np.quantile(steps[steps > 0.0], _SHORTEST))
        longest = float(np.max(time) - np.min(time))
        low = math.floor(_ROUNDED * math.log10(shortest)) / _ROUNDED
        high = math.ceil(_ROUNDED * math.log10(longest)) / _ROUNDED
        return cls(*_fixed(low, high))

    def fractions(self, fractions: Array, rates: Array) -> Array:
        """Return fractions (K, L + 1) that fit spectra of fractions (K, R + 1) and rates (K, R)."""
        return np.asarray(relaxation_of(fractions, rates, self.times) @ self.matrix.T)


def relaxation_of(fractions: Array, rates: Array, times: Array) -> Array:
    """Return the relaxation function (K, N) at times (N,) of fractions (K, R + 1), rates (K, R)."""
    with np.errstate(invalid="ignore"):  # an infinite rate at time 0: the force is discarded
        decays = np.exp(-rates[:, :, None] * times)
    return np.asarray(fractions[:, :1] + np.einsum("kr,krn->kn", fractions[:, 1:], decays))


@lru_cache(maxsize=16)
def _fixed(low: float, high: float) -> tuple[Array, Array, Array]:
    """Return rates, times and matrix for times between 10**low and 10**high (s)."""
    begin, end = 10.0**low / _BEFORE, 10.0**high * _BEYOND
    decades = math.log10(end / begin)
    count = math.ceil(_A_DECADE * decades) + 1 + len(_FASTER)
    count += -count % _MULTIPLE
    dense = np.geomspace(1.0 / begin, 1.0 / end, count - len(_FASTER))
    rates = np.concatenate([np.array(_FASTER) / begin, dense])
    points = math.ceil(_TIMES * (decades + math.log10(_FASTER[-1])))
    times = np.append(0.0, np.geomspace(begin / _FASTER[-1], end, points))
    weights = np.where(times < begin, _WITHIN, 1.0)
    weights[0] = _AT_ONCE
    shapes = np.column_stack([np.ones_like(times), np.exp(-np.outer(times, rates))])
    return rates, times, np.linalg.pinv(shapes * weights[:, None], rcond=1e-9) * weights
