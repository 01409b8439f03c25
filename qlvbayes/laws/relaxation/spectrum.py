"""A spectrum as it is, for what makes one of another."""

from __future__ import annotations

from typing import Any, ClassVar, Self

from jaxtyping import Array

from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.scales import Scales


class Spectrum(AbstractRelaxation):
    """A spectrum given as it is: fractions (L + 1,) and rates (L,) in 1/s."""

    fractions: Any
    rates: Any
    name: ClassVar[str] = "spectrum"
    units: ClassVar[dict[str, str]] = {}
    meanings: ClassVar[dict[str, str]] = {}
    law: ClassVar[str] = "any spectrum"
    reference: ClassVar[str] = ""

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """No law of its own."""
        raise NotImplementedError

    def spectrum(self) -> tuple[Array, Array]:
        """As given."""
        return self.fractions, self.rates

    def times(self) -> dict[str, Array]:
        """None of its own."""
        return {}
