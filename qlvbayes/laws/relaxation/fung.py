"""Define Fung's reduced relaxation function: a box spectrum in the logarithm of time."""

from __future__ import annotations

from typing import ClassVar, Self

from numpy.polynomial.legendre import leggauss

from qlvbayes import xp
from qlvbayes.laws.relaxation.law import AbstractRelaxation, decades_of, shared_out
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import static
from qlvbayes.xp import Array

_PER_DECADE = 4  # Gauss-Legendre nodes; with two in addition the error is below 1e-6 of g(0)


class Fung(AbstractRelaxation):
    r"""Spectrum c/tau of relaxation times between tau1 and tau2, and none outside.

    .. math:: g(t) = \frac{1 + c\,[E_1(t/\tau_2) - E_1(t/\tau_1)]}{1 + c \ln(\tau_2/\tau_1)}

    FEBio's relaxation-Fung is uniform in tau; this box, uniform in ln tau, is its relaxation-Malkin
    in the limit beta -> 1.

    Parameters
    ----------
    c
        Height of the box over ln tau, zero or more.
    tau1, tau2
        Ends of the box (s), in either order.
    nodes
        Number of Gauss-Legendre nodes between ln tau1 and ln tau2, which move with both; 26 give
        1e-6 of g(0) over six decades.

    References
    ----------
    Fung 1993, doi:10.1007/978-1-4757-2257-4, section 7.6
    """

    c: Constant
    tau1: Constant
    tau2: Constant
    nodes: int = static(default=26)
    name: ClassVar[str] = "fung"
    units: ClassVar[dict[str, str]] = {"c": "fraction", "tau1": "time", "tau2": "time"}
    meanings: ClassVar[dict[str, str]] = {
        "c": "strength of relaxation over each factor e of time",
        "tau1": "when relaxation begins",
        "tau2": "when relaxation ends",
    }
    law: ClassVar[str] = "g(t) = {1 + c [E1(t/tau2) − E1(t/tau1)]} / {1 + c ln(tau2/tau1)}"
    reference: ClassVar[str] = "Fung 1993, doi:10.1007/978-1-4757-2257-4, section 7.6"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors: a box from sampling interval to longest phase."""
        decades = decades_of(scales)
        height = lognormal(1.0 / (decades * 2.3), 3.0)
        first, last = lognormal(3.0 * scales.shortest, 10.0), lognormal(scales.longest, 10.0)
        return cls(height, first, last, _PER_DECADE * decades + 2)

    def spectrum(self) -> tuple[Array, Array]:
        """Return the Gauss-Legendre quadrature of the spectrum in ln tau."""
        points, weights = (xp.along_first(x, self.c) for x in leggauss(self.nodes))
        low, high = xp.log(self.tau1), xp.log(self.tau2)
        rates = xp.exp(-0.5 * (low + high) - 0.5 * (high - low) * points)
        width = xp.abs(high - low)
        return shared_out(1.0 / (1.0 + self.c * width), weights), rates

    def times(self) -> dict[str, Array]:
        """Return the ends of the box (s)."""
        return {"tau1": self.tau1, "tau2": self.tau2}
