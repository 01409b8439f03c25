"""Define the relaxation law whose times are log-normally distributed."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.laws.relaxation.law import AbstractRelaxation, middle_of, shared_out
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogNormal, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

# nodes in sds of ln tau: they end where the normal density is 1e-6 of its peak, and their step of
# 0.2 sds resolves a mode's decay (pi^2/1.6 e-folds) to sigma = 3.3
_NODES = np.linspace(-5.3, 5.3, 53)


class LogNormalSpectrum(AbstractRelaxation):
    r"""Relaxation times whose logarithm is normal with mean ln(tau) and sd sigma.

    .. math:: g(t) = c_0 + (1 - c_0) \int_{-\infty}^\infty
              \frac{e^{-z^2/2}}{\sqrt{2 \pi}} \exp(-\frac{t}{\tau} e^{-\sigma z})\, dz

    The trapezoidal rule in z has 53 nodes that move with tau and sigma; its error is 1e-6 of g(0).

    Parameters
    ----------
    c0
        Share that never relaxes.
    tau
        Median relaxation time (s).
    sigma
        Standard deviation of the logarithm of relaxation time, up to 3.

    References
    ----------
    Wiechert 1893, doi:10.1002/andp.18932861011
    """

    c0: Constant
    tau: Constant
    sigma: Constant
    name: ClassVar[str] = "log-normal"
    units: ClassVar[dict[str, str]] = {"c0": "fraction", "tau": "time", "sigma": "count"}
    meanings: ClassVar[dict[str, str]] = {
        "c0": "share that never relaxes",
        "tau": "median relaxation time",
        "sigma": "spread of the logarithm of relaxation times",
    }
    law: ClassVar[str] = "g(t) = c0 + (1 − c0) ∫ exp(−t/θ) N(ln θ; ln tau, sigma) d ln θ"
    reference: ClassVar[str] = "Wiechert 1893, doi:10.1002/andp.18932861011"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors; tau may lie anywhere in the measurable range."""
        return cls(Uniform(0.0, 1.0), LogNormal(*middle_of(scales)), lognormal(1.5, 1.5))

    def spectrum(self) -> tuple[Array, Array]:
        """Return the trapezoidal rule over the normal density."""
        nodes = xp.along_first(_NODES, self.tau)
        rates = xp.exp(-self.sigma * nodes) / self.tau
        return shared_out(self.c0, np.exp(-0.5 * nodes**2)), rates

    def times(self) -> dict[str, Array]:
        """Return the median relaxation time (s)."""
        return {"tau": self.tau}
