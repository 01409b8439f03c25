"""Relaxation with times of a continuous distribution: log-normal, a box, or a power law."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np
from numpy.polynomial.legendre import leggauss

from qlvbayes import xp
from qlvbayes.laws.relaxation.law import AbstractRelaxation, decades_of, middle_of, shared_out
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogNormal, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import static
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


_STEP = 0.58  # in ln(rate tau): the rule's error, 2 |Gamma(alpha + 2 pi i/0.58)|/Gamma(alpha),
# is 7e-7 at alpha = 1
_TOP = 3.6  # ln(rate tau) above which a gamma density in the rate is e^-36
_BELOW = 2.5  # decades of rate below one over the longest time that have nodes of their own


class PowerLaw(AbstractRelaxation):
    r"""Relaxation by a power of time, regularised at short times.

    .. math:: g(t) = c_0 + (1 - c_0)(1 + t/\tau)^{-\alpha}, \qquad
              (1 + t/\tau)^{-\alpha} = \int_0^\infty
              \frac{s^{\alpha - 1} e^{-s}}{\Gamma(\alpha)} e^{-s t/\tau} ds

    The spectrum is a gamma density in the rate.

    Parameters
    ----------
    c0
        Share that never relaxes.
    alpha
        Exponent, above 0.
    tau
        Time at which the power law begins (s).
    nodes
        Number of nodes of the trapezoidal rule in ln s; the last stands for all slower rates, with
        their mean. 48 give 1e-6 of g(0) to t = 1e7 tau for alpha to 1 (3e-5 at 2, 2e-4 at 3).

    References
    ----------
    Nutting 1921, doi:10.1016/S0016-0032(21)90171-6
    """

    c0: Constant
    alpha: Constant
    tau: Constant
    nodes: int = static(default=48)
    name: ClassVar[str] = "power-law"
    units: ClassVar[dict[str, str]] = {"c0": "fraction", "alpha": "count", "tau": "time"}
    meanings: ClassVar[dict[str, str]] = {
        "c0": "share that never relaxes",
        "alpha": "exponent of relaxation in time",
        "tau": "when the power law begins",
    }
    law: ClassVar[str] = "g(t) = c0 + (1 − c0)(1 + t/tau)^(−alpha)"
    reference: ClassVar[str] = "Nutting 1921, doi:10.1016/S0016-0032(21)90171-6"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors; tau may lie anywhere in the measurable range."""
        lowest = math.log(10.0) * (decades_of(scales) + _BELOW)
        nodes = math.ceil((lowest + _TOP) / _STEP) + 1
        return cls(Uniform(0.0, 1.0), lognormal(0.3, 2.5), LogNormal(*middle_of(scales)), nodes)

    def spectrum(self) -> tuple[Array, Array]:
        """Return the trapezoidal rule in ln s, with one more term for all slower rates."""
        steps = xp.along_first(_TOP - _STEP * np.arange(self.nodes - 1), self.alpha)
        weights = _STEP * xp.exp(self.alpha * steps - np.exp(steps) - xp.gammaln(self.alpha))
        # the sum over all nodes below the lowest, where e^-s is 1, and their mean rate
        slower, mean = (
            1.0 / xp.expm1(_STEP * self.alpha),
            1.0 / xp.expm1(_STEP * (self.alpha + 1.0)),
        )
        rates = xp.concatenate([np.exp(steps), (np.exp(steps[-1]) * mean / slower)[None]])
        weights = xp.concatenate([weights, (weights[-1] * slower)[None]])
        return shared_out(self.c0, weights), rates / self.tau

    def times(self) -> dict[str, Array]:
        """Return the time (s) at which the power law begins."""
        return {"tau": self.tau}
