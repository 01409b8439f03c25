"""Relaxation with times of a continuous distribution: log-normal, a box, power law, stretched."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from numpy.polynomial.legendre import leggauss

from qlvbayes import xp
from qlvbayes.laws.relaxation.law import AbstractRelaxation, decades_of, middle_of, shared_out
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogNormal, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant, static
from qlvbayes.xp import Array

# nodes in sds of ln tau: they end where the normal density is 1e-6 of its peak, and their step of
# 0.2 sds resolves a mode's decay (pi^2/1.6 e-folds) to sigma = 3.3
_NODES = np.linspace(-5.3, 5.3, 53)


class LogNormalSpectrum(AbstractRelaxation):
    r"""Relaxation times whose logarithm is normal with mean ln(tau) and sd sigma.

    .. math:: g(t) = c_0 + (1 - c_0) \int_{-\infty}^\infty
              \frac{e^{-z^2/2}}{\sqrt{2 \pi}} \exp(-\frac{t}{\tau} e^{-\sigma z})\, dz

    The trapezoidal rule in z has 53 nodes that move with tau and sigma; its error is 1e-6 of g(0).
    """

    c0: Constant = constant("fraction", "share that never relaxes")
    tau: Constant = constant("time", "median relaxation time")
    sigma: Constant = constant("count", "spread of the logarithm of relaxation times")
    name = "log-normal"
    law = "g(t) = c0 + (1 − c0) ∫ exp(−t/θ) N(ln θ; ln tau, sigma) d ln θ"
    reference = "Wiechert 1893, doi:10.1002/andp.18932861011"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(Uniform(0.0, 1.0), LogNormal(*middle_of(scales)), lognormal(1.5, 1.5))

    def spectrum(self) -> tuple[Array, Array]:
        nodes = xp.along_first(_NODES, self.tau)
        rates = xp.exp(-self.sigma * nodes) / self.tau
        return shared_out(self.c0, np.exp(-0.5 * nodes**2)), rates

    def times(self) -> dict[str, Array]:
        return {"tau": self.tau}


_PER_DECADE = 4  # Gauss-Legendre nodes; with two in addition the error is below 1e-6 of g(0)


class Fung(AbstractRelaxation):
    r"""Spectrum c/tau of relaxation times between tau1 and tau2, and none outside.

    .. math:: g(t) = \frac{1 + c\,[E_1(t/\tau_2) - E_1(t/\tau_1)]}{1 + c \ln(\tau_2/\tau_1)}

    FEBio's relaxation-Fung is uniform in tau; this box, uniform in ln tau, is its relaxation-Malkin
    in the limit beta -> 1.

    ``nodes`` is the number of Gauss-Legendre nodes between ln tau1 and ln tau2, in either order,
    which move with both; 26 give 1e-6 of g(0) over six decades.
    """

    c: Constant = constant("fraction", "strength of relaxation over each factor e of time")
    tau1: Constant = constant("time", "when relaxation begins")
    tau2: Constant = constant("time", "when relaxation ends")
    nodes: int = static(default=26)
    name = "fung"
    law = "g(t) = {1 + c [E1(t/tau2) − E1(t/tau1)]} / {1 + c ln(tau2/tau1)}"
    reference = "Fung 1993, doi:10.1007/978-1-4757-2257-4, section 7.6"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        decades = decades_of(scales)
        height = lognormal(1.0 / (decades * 2.3), 3.0)
        first, last = lognormal(3.0 * scales.shortest, 10.0), lognormal(scales.longest, 10.0)
        return cls(height, first, last, _PER_DECADE * decades + 2)

    def spectrum(self) -> tuple[Array, Array]:
        points, weights = (xp.along_first(x, self.c) for x in leggauss(self.nodes))
        low, high = xp.log(self.tau1), xp.log(self.tau2)
        rates = xp.exp(-0.5 * (low + high) - 0.5 * (high - low) * points)
        width = xp.abs(high - low)
        return shared_out(1.0 / (1.0 + self.c * width), weights), rates

    def times(self) -> dict[str, Array]:
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

    ``nodes`` is the number of nodes of the trapezoidal rule in ln s; the last stands for all slower
    rates, with their mean. 48 give 1e-6 of g(0) to t = 1e7 tau for alpha to 1 (3e-5 at 2, 2e-4 at
    3).
    """

    c0: Constant = constant("fraction", "share that never relaxes")
    alpha: Constant = constant("count", "exponent of relaxation in time")
    tau: Constant = constant("time", "when the power law begins")
    nodes: int = static(default=48)
    name = "power-law"
    law = "g(t) = c0 + (1 − c0)(1 + t/tau)^(−alpha)"
    reference = "Nutting 1921, doi:10.1016/S0016-0032(21)90171-6"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        lowest = math.log(10.0) * (decades_of(scales) + _BELOW)
        nodes = math.ceil((lowest + _TOP) / _STEP) + 1
        return cls(Uniform(0.0, 1.0), lognormal(0.3, 2.5), LogNormal(*middle_of(scales)), nodes)

    def spectrum(self) -> tuple[Array, Array]:
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
        return {"tau": self.tau}


_STABLE_NODES = 56  # of the trapezoidal rule; with fewer the error is above 1e-6 at beta = 0.15
_FASTEST = 25.0  # ln(rate tau): below t = 2e-10 tau the spectrum's far end no longer relaxes
_CUT = 18.0  # the density of slow rates ends at e^-18
_ANGLES, _WEIGHTS = leggauss(128)  # resolve Zolotarev's integral to s^beta = 1.5 and beta = 0.95
_CROSSING = 1.5  # value of s^beta above which the series is used
_SERIES_TERMS = (
    40  # of the series: 1.5^-40 is 1e-7 of its first term, less by 1/k! Gamma(k beta + 1)
)


class StretchedExponential(AbstractRelaxation):
    r"""Relaxation by a stretched exponential (Kohlrausch, Williams and Watts).

    .. math:: g(t) = c_0 + (1 - c_0) e^{-(t/\tau)^\beta}

    The spectrum over the rate is the one-sided stable density (Pollard 1946). The trapezoidal rule
    takes it at 56 nodes, which are even in ln(rate) where rates are fast, and even in the logarithm
    of the density's own decay where they are slow.
    """

    c0: Constant = constant("fraction", "share that never relaxes")
    beta: Constant = constant(
        "count", "how little relaxation is stretched: 1 is a single exponential"
    )
    tau: Constant = constant("time", "when 1/e of what relaxes is left")
    name = "stretched"
    law = "g(t) = c0 + (1 − c0) exp(−(t/tau)^beta)"
    reference = "Williams & Watts 1970, doi:10.1039/TF9706600080"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(Uniform(0.0, 1.0), Uniform(0.15, 0.95), LogNormal(*middle_of(scales)))

    def spectrum(self) -> tuple[Array, Array]:
        log_rates, weights = xp.of_distinct(_weighted_nodes, self.beta)
        left = xp.maximum(1.0 - xp.sum(weights), 0.0)
        weights = xp.concatenate([weights[:-1], weights[-1:] + left])
        return shared_out(self.c0, weights), xp.exp(log_rates) / self.tau

    def times(self) -> dict[str, Array]:
        return {"tau": self.tau}


def _weighted_nodes(beta: Array) -> tuple[Array, Array]:
    """Return (k,) logarithms of rate times tau, and the share that relaxes with each."""
    log_rates, steps = _spread_nodes(beta)
    return log_rates, log_rate_density(log_rates, beta) * steps


def _spread_nodes(beta: Array) -> tuple[Array, Array]:
    """Return (k,) logarithms of rate times tau, from the slowest, and the weights of the nodes."""
    slope = xp.minimum((1.0 - beta) / beta, 1.0)
    decay = (1.0 - beta) * beta ** (beta / (1.0 - beta))
    lowest = -(1.0 - beta) / beta * xp.log(_CUT / decay) / slope
    x = lowest + (_FASTEST - lowest) * xp.along_first(np.linspace(0.0, 1.0, _STABLE_NODES), beta)
    step = (_FASTEST - lowest) / (_STABLE_NODES - 1)
    log_rates = slope * x + (1.0 - slope) * xp.softplus(x)
    return log_rates, step * (slope + (1.0 - slope) * xp.sigmoid(x))


def log_rate_density(log_rate: Array, beta: Array) -> Array:
    r"""Return s rho(s) at ln s = ``log_rate`` (k,), with int rho(s) e^{-s t} ds = e^{-t^beta}.

    Slow rates are taken from Zolotarev's integral, fast ones from the series in s^{-beta}; 0 < beta
    < 1.

    .. math:: s \rho = \frac{\beta}{\pi (1 - \beta)} \int_0^\pi w\, e^{-w} du, \quad
              w = s^{-\beta/(1-\beta)} \frac{\sin((1-\beta) u)\, \sin(\beta u)^{\beta/(1-\beta)}}
              {\sin(u)^{1/(1-\beta)}}

    Zolotarev 1986, doi:10.1090/mmono/065; series: Pollard 1946,
    doi:10.1090/S0002-9904-1946-08672-3.
    """
    fast = beta * log_rate > np.log(_CROSSING)
    # each branch stays within its own range, so that neither overflows where it is not used
    slow_rate = xp.where(fast, 0.0, log_rate)
    fast_rate = xp.where(fast, log_rate, np.log(_CROSSING) / beta)
    return xp.where(fast, _series(fast_rate, beta), _integral(slow_rate, beta))


def _integral(log_rate: Array, beta: Array) -> Array:
    angle, weight = (xp.along_first(x, beta) for x in (0.5 * np.pi * (1.0 + _ANGLES), _WEIGHTS))
    power = beta / (1.0 - beta)
    log_shape = (
        xp.log(xp.sin((1.0 - beta) * angle))
        + power * xp.log(xp.sin(beta * angle))
        - xp.log(np.sin(angle)) / (1.0 - beta)
    )
    log_w = xp.minimum(log_shape - power * log_rate[:, None], 50.0)  # e^-e^50 is nothing
    values = xp.exp(log_w - xp.exp(log_w))
    return 0.5 * power * (values * weight).sum(axis=1)


def _series(log_rate: Array, beta: Array) -> Array:
    k = xp.along_first(np.arange(1, _SERIES_TERMS + 1), beta)
    signs = np.where(k % 2, 1.0, -1.0) / np.pi
    logs = xp.gammaln(k * beta + 1.0) - xp.gammaln(k + 1.0) - k * beta * log_rate[:, None]
    return (xp.exp(logs) * (signs * xp.sin(np.pi * beta * k))).sum(axis=1)
