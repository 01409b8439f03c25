"""The reduced relaxation function as a Prony series."""

from __future__ import annotations

from typing import Any, ClassVar, Self

from jaxtyping import Array

from qlvbayes.laws.relaxation.law import AbstractRelaxation, middle_of
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Dirichlet, LogNormal, Ordered

MOST = 6  # modes; more than that no test tells apart


class Prony(AbstractRelaxation):
    r"""g(t) = c_0 + sum_{i=1}^r c_i e^{-v_i t}, the paper's Eq. 7, with sum c = 1.

    c: (r + 1,) fractions, c[0] the part that never relaxes; v: (r,) rates (1/s), largest first.
    """

    c: Any
    v: Any
    name: ClassVar[str] = "prony"
    units: ClassVar[dict[str, str]] = {"c": "fraction", "v": "rate"}
    meanings: ClassVar[dict[str, str]] = {
        "c": "share that relaxes with a mode, c[0] of what never does",
        "v": "rate of a mode",
    }
    law: ClassVar[str] = "g(t) = c[0] + Σ c[i] exp(−v[i] t), Σ c = 1"
    reference: ClassVar[str] = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"
    first_index: ClassVar[dict[str, int]] = {"v": 1}

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Two modes."""
        return cls.of_modes(scales, 2)

    @classmethod
    def of_modes(cls, scales: Scales, modes: int) -> Self:
        """Fractions uniform on the simplex; rates alike, log-normal, in falling order.

        The measurable range (one over the longest phase to one over the shortest interval) lies
        inside two sds.
        """
        middle, width = middle_of(scales)
        rates = Ordered(tuple(LogNormal(-middle, width) for _ in range(modes)))
        return cls(Dirichlet([1.0] * (modes + 1)), rates)

    def spectrum(self) -> tuple[Array, Array]:
        """The constants themselves."""
        return self.c, self.v

    def times(self) -> dict[str, Array]:
        """One over each rate."""
        return {f"1/v[{k}]": 1.0 / rate for k, rate in enumerate(self.v, 1)}
