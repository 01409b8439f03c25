"""Fung's reduced relaxation function: a box spectrum in the logarithm of time."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array
from numpy.polynomial.legendre import leggauss

from qlvbayes.laws.relaxation.law import AbstractRelaxation, decades_of, shared_out
from qlvbayes.laws.scales import Scales, lognormal

_PER_DECADE = 4  # Gauss-Legendre nodes; with two more the error stays below 1e-6 of g(0)


class Fung(AbstractRelaxation):
    r"""Spectrum c/tau between tau1 and tau2, none outside (Fung 1972).

    .. math:: g(t) = \frac{1 + c\,[E_1(t/\tau_2) - E_1(t/\tau_1)]}{1 + c \ln(\tau_2/\tau_1)}

    c: height of the box over ln tau, zero or more; tau1, tau2: its ends (s), in either order.
    nodes: of the Gauss-Legendre quadrature between ln tau1 and ln tau2, which move with these;
    26 give 1e-6 of g(0) for six decades. Beware of names: FEBio's relaxation-Fung is uniform in
    tau; this box, uniform in ln tau, is its relaxation-Malkin in the limit beta -> 1.
    """

    c: Any
    tau1: Any
    tau2: Any
    nodes: int = eqx.field(static=True, default=26)
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
        """The box ends near the sampling interval and the longest phase, within a factor 10.

        Over that range half of the force relaxes at the prior's median. Nodes for a box from a
        tenth of the one to ten times the other.
        """
        decades = decades_of(scales)
        height = lognormal(1.0 / (decades * 2.3), 3.0)
        first, last = lognormal(3.0 * scales.shortest, 10.0), lognormal(scales.longest, 10.0)
        return cls(height, first, last, _PER_DECADE * decades + 2)

    def spectrum(self) -> tuple[Array, Array]:
        """Gauss-Legendre in ln tau."""
        places, weights = leggauss(self.nodes)
        low, high = jnp.log(self.tau1), jnp.log(self.tau2)
        rates = jnp.exp(-0.5 * (low + high) - 0.5 * (high - low) * places)
        width = jnp.abs(high - low)
        return shared_out(1.0 / (1.0 + self.c * width), jnp.asarray(weights)), rates

    def times(self) -> dict[str, Array]:
        """The ends of the box."""
        return {"tau1": self.tau1, "tau2": self.tau2}
