"""Relaxation by a few exponentials: the Prony series, and any given spectrum."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.laws.relaxation.law import AbstractRelaxation, middle_of
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Dirichlet, LogNormal, Ordered
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class Prony(AbstractRelaxation):
    """Prony series of relaxation, g(t) = c_0 + sum_{i=1}^r c_i e^{-v_i t}, the paper's Eq. 7."""

    c: Constant = constant("fraction", "share that relaxes with a mode, c[0] of what never does")
    v: Constant = constant("rate", "rate of a mode")
    name = "prony"
    law = "g(t) = c[0] + Σ c[i] exp(−v[i] t), Σ c = 1"
    reference = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"
    first_index: ClassVar[dict[str, int]] = {"v": 1}

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls.with_modes(scales, 2)

    @classmethod
    def with_modes(cls, scales: Scales, modes: int) -> Self:
        """Return a series with this number of modes under default priors.

        Fractions are uniform on the simplex. Rates are log-normal, alike, and in falling order; the
        measurable range (one over the longest phase to one over the shortest interval) lies inside
        two sds.
        """
        middle, width = middle_of(scales)
        rates = Ordered(tuple(LogNormal(-middle, width) for _ in range(modes)))
        return cls(Dirichlet([1.0] * (modes + 1)), rates)

    def spectrum(self) -> tuple[Array, Array]:
        return self.c, self.v

    def times(self) -> dict[str, Array]:
        return {f"1/v[{k}]": 1.0 / rate for k, rate in enumerate(self.v, 1)}


class Spectrum(AbstractRelaxation):
    """Relaxation with a given discrete spectrum."""

    fractions: Constant  # (L + 1,); the first is the share that never relaxes
    rates: Constant  # (L,) in 1/s
    name = "spectrum"
    units: ClassVar[dict[str, str]] = {}
    meanings: ClassVar[dict[str, str]] = {}
    law = "any spectrum"
    reference = ""

    @classmethod
    def default(cls, scales: Scales) -> Self:
        raise NotImplementedError

    def spectrum(self) -> tuple[Array, Array]:
        return self.fractions, self.rates

    def times(self) -> dict[str, Array]:
        return {}
