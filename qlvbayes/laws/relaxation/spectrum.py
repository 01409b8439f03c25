"""Define a relaxation law by its spectrum, for effects that change another law's."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Spectrum(AbstractRelaxation):
    """Relaxation with a given discrete spectrum."""

    fractions: Constant  # (L + 1,); the first is the share that never relaxes
    rates: Constant  # (L,) in 1/s
    name: ClassVar[str] = "spectrum"
    units: ClassVar[dict[str, str]] = {}
    meanings: ClassVar[dict[str, str]] = {}
    law: ClassVar[str] = "any spectrum"
    reference: ClassVar[str] = ""

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Raise NotImplementedError: a given spectrum has no default."""
        raise NotImplementedError

    def spectrum(self) -> tuple[Array, Array]:
        """Return the spectrum as it was given."""
        return self.fractions, self.rates

    def times(self) -> dict[str, Array]:
        """Return no times: a spectrum has no constants of its own."""
        return {}
