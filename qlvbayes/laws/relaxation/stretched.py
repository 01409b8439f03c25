"""Define the stretched exponential, whose rates have the one-sided stable density."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np
from numpy.polynomial.legendre import leggauss

from qlvbayes import xp
from qlvbayes.laws.relaxation.law import AbstractRelaxation, middle_of, shared_out
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogNormal, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_NODES = 56  # of the trapezoidal rule; with fewer the error is above 1e-6 at beta = 0.15
_FASTEST = 25.0  # ln(rate tau): below t = 2e-10 tau the spectrum's far end no longer relaxes
_CUT = 18.0  # the density of slow rates ends at e^-18
_ANGLES, _WEIGHTS = leggauss(128)  # resolve Zolotarev's integral to s^beta = 1.5 and beta = 0.95
_CROSSING = 1.5  # value of s^beta above which the series is used
_TERMS = 40  # of the series: 1.5^-40 is 1e-7 of its first term, less by 1/k! Gamma(k beta + 1)


class StretchedExponential(AbstractRelaxation):
    r"""Relaxation by a stretched exponential (Kohlrausch, Williams and Watts).

    .. math:: g(t) = c_0 + (1 - c_0) e^{-(t/\tau)^\beta}

    The spectrum over the rate is the one-sided stable density (Pollard 1946). The trapezoidal rule
    takes it at 56 nodes, which are even in ln(rate) where rates are fast, and even in the logarithm
    of the density's own decay where they are slow.

    Parameters
    ----------
    c0
        Share that never relaxes.
    beta
        Exponent, from 0.15 to 0.95; at 1 relaxation would be a single exponential.
    tau
        Time (s) at which 1/e of the relaxing share is left.

    References
    ----------
    Williams & Watts 1970, doi:10.1039/TF9706600080
    """

    c0: Constant
    beta: Constant
    tau: Constant
    name: ClassVar[str] = "stretched"
    units: ClassVar[dict[str, str]] = {"c0": "fraction", "beta": "count", "tau": "time"}
    meanings: ClassVar[dict[str, str]] = {
        "c0": "share that never relaxes",
        "beta": "how little relaxation is stretched: 1 is a single exponential",
        "tau": "when 1/e of what relaxes is left",
    }
    law: ClassVar[str] = "g(t) = c0 + (1 − c0) exp(−(t/tau)^beta)"
    reference: ClassVar[str] = "Williams & Watts 1970, doi:10.1039/TF9706600080"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors; tau may lie anywhere in the measurable range."""
        middle, width = middle_of(scales)
        return cls(Uniform(0.0, 1.0), Uniform(0.15, 0.95), LogNormal(middle, width))

    def spectrum(self) -> tuple[Array, Array]:
        """Return the trapezoidal rule over the stable density."""
        log_rates, weights = xp.of_distinct(_weighted_nodes, self.beta)
        left = xp.maximum(1.0 - xp.sum(weights), 0.0)
        weights = xp.concatenate([weights[:-1], weights[-1:] + left])
        return shared_out(self.c0, weights), xp.exp(log_rates) / self.tau

    def times(self) -> dict[str, Array]:
        """Return tau (s)."""
        return {"tau": self.tau}


def _weighted_nodes(beta: Array) -> tuple[Array, Array]:
    """Return (k,) logarithms of rate times tau, and the share that relaxes with each."""
    log_rates, steps = _nodes(beta)
    return log_rates, log_rate_density(log_rates, beta) * steps


def _nodes(beta: Array) -> tuple[Array, Array]:
    """Return (k,) logarithms of rate times tau, from the slowest, and the weights of the nodes."""
    slope = xp.minimum((1.0 - beta) / beta, 1.0)
    decay = (1.0 - beta) * beta ** (beta / (1.0 - beta))
    lowest = -(1.0 - beta) / beta * xp.log(_CUT / decay) / slope
    x = lowest + (_FASTEST - lowest) * xp.along_first(np.linspace(0.0, 1.0, _NODES), beta)
    step = (_FASTEST - lowest) / (_NODES - 1)
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
    k = xp.along_first(np.arange(1, _TERMS + 1), beta)
    signs = np.where(k % 2, 1.0, -1.0) / np.pi
    logs = xp.gammaln(k * beta + 1.0) - xp.gammaln(k + 1.0) - k * beta * log_rate[:, None]
    return (xp.exp(logs) * (signs * xp.sin(np.pi * beta * k))).sum(axis=1)
