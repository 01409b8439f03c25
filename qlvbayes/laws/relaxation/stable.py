"""The one-sided stable density, whose Laplace transform is exp(-t^beta)."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaln
from jaxtyping import Array
from numpy.polynomial.legendre import leggauss

_ANGLES, _WEIGHTS = leggauss(128)  # resolve Zolotarev's integral to s^beta = 1.5 and beta = 0.95
_CROSSING = 1.5  # of s^beta, from which the series takes over
_TERMS = 40  # of the series: 1.5^-40 is 1e-7 of its first term, less by 1/k! Gamma(k beta + 1)


def log_rate_density(log_rate: Array, beta: Array) -> Array:
    r"""S rho(s) at ln s = ``log_rate`` (k,), with int rho(s) e^{-s t} ds = e^{-t^beta}.

    Slow rates by Zolotarev's integral, fast ones by the series in s^{-beta}; 0 < beta < 1.

    .. math:: s \rho = \frac{\beta}{\pi (1 - \beta)} \int_0^\pi w\, e^{-w} du, \quad
              w = s^{-\beta/(1-\beta)} \frac{\sin((1-\beta) u)\, \sin(\beta u)^{\beta/(1-\beta)}}
              {\sin(u)^{1/(1-\beta)}}

    Zolotarev 1986, doi:10.1090/mmono/065; series: Pollard 1946,
    doi:10.1090/S0002-9904-1946-08672-3.
    """
    fast = beta * log_rate > jnp.log(_CROSSING)
    # each branch within its own range, so that neither overflows where it is not used
    slow_rate = jnp.where(fast, 0.0, log_rate)
    fast_rate = jnp.where(fast, log_rate, jnp.log(_CROSSING) / beta)
    return jnp.where(fast, _series(fast_rate, beta), _integral(slow_rate, beta))


def _integral(log_rate: Array, beta: Array) -> Array:
    angle = 0.5 * np.pi * (1.0 + _ANGLES)
    power = beta / (1.0 - beta)
    log_shape = (
        jnp.log(jnp.sin((1.0 - beta) * angle))
        + power * jnp.log(jnp.sin(beta * angle))
        - jnp.log(np.sin(angle)) / (1.0 - beta)
    )
    log_w = jnp.minimum(log_shape - power * log_rate[:, None], 50.0)  # e^-e^50 is nothing
    values = jnp.exp(log_w - jnp.exp(log_w))
    return power / np.pi * values @ (0.5 * np.pi * _WEIGHTS)


def _series(log_rate: Array, beta: Array) -> Array:
    k = np.arange(1, _TERMS + 1)
    signs = np.where(k % 2, 1.0, -1.0) / np.pi
    logs = gammaln(k * beta + 1.0) - gammaln(k + 1.0) - k * beta * log_rate[:, None]
    return jnp.exp(logs) @ (signs * jnp.sin(np.pi * beta * k))
