"""Relaxation times that are log-normally distributed."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.laws.relaxation.law import AbstractRelaxation, middle_of, shared_out
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogNormal, Uniform

# sds of ln tau: the trapezoid ends where the normal density is 1e-6 of its peak, and its step of
# 0.2 sds resolves a mode's decay (pi^2/1.6 e-folds) to sigma = 3.3
_PLACES = np.linspace(-5.3, 5.3, 53)


class LogNormalSpectrum(AbstractRelaxation):
    r"""ln tau is normal with mean ln(tau) and standard deviation sigma.

    .. math:: g(t) = c_0 + (1 - c_0) \int_{-\infty}^\infty
              \frac{e^{-z^2/2}}{\sqrt{2 \pi}} \exp(-\frac{t}{\tau} e^{-\sigma z})\, dz

    c0: share that never relaxes; tau: median relaxation time (s); sigma: sd of its logarithm, to
    3. The trapezoid in z moves with tau and sigma: 53 nodes, 1e-6 of g(0).
    """

    c0: Any
    tau: Any
    sigma: Any
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
        """c0 uniform; tau anywhere in the measurable range; sigma within a factor 1.5 of 1.5."""
        return cls(Uniform(0.0, 1.0), LogNormal(*middle_of(scales)), lognormal(1.5, 1.5))

    def spectrum(self) -> tuple[Array, Array]:
        """Trapezoid over the normal density."""
        rates = jnp.exp(-self.sigma * _PLACES) / self.tau
        return shared_out(self.c0, jnp.asarray(np.exp(-0.5 * _PLACES**2))), rates

    def times(self) -> dict[str, Array]:
        """The median."""
        return {"tau": self.tau}
