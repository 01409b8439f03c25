"""The stretched exponential."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.laws.relaxation.law import AbstractRelaxation, middle_of, shared_out
from qlvbayes.laws.relaxation.stable import log_rate_density
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogNormal, Uniform

_NODES = 56  # of the trapezoid; fewer miss 1e-6 at beta = 0.15
_FASTEST = 25.0  # ln(rate tau): below t = 2e-10 tau the spectrum's far end no longer relaxes
_CUT = 18.0  # the density of slow rates ends at e^-18


class StretchedExponential(AbstractRelaxation):
    r"""The law of Kohlrausch, Williams and Watts.

    .. math:: g(t) = c_0 + (1 - c_0) e^{-(t/\tau)^\beta}

    c0: share that never relaxes; beta: 0.15 to 0.95; tau: when 1/e of the rest is left (s). The
    spectrum over the rate is the one-sided stable density (Pollard 1946); a trapezoid takes it
    at 56 nodes, evenly in ln(rate) where rates are fast and, where they are slow, in the
    logarithm of the density's own decay.
    """

    c0: Any
    beta: Any
    tau: Any
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
        """c0 uniform; beta uniform in 0.15 to 0.95; tau anywhere in the measurable range."""
        middle, width = middle_of(scales)
        return cls(Uniform(0.0, 1.0), Uniform(0.15, 0.95), LogNormal(middle, width))

    def spectrum(self) -> tuple[Array, Array]:
        """Trapezoid over the stable density; its fastest node holds all that is faster."""
        log_rates, steps = _places(self.beta)
        weights = log_rate_density(log_rates, self.beta) * steps
        left = jnp.maximum(1.0 - jnp.sum(weights), 0.0)
        weights = weights.at[-1].add(left)
        return shared_out(self.c0, weights), jnp.exp(log_rates) / self.tau

    def times(self) -> dict[str, Array]:
        """The one time."""
        return {"tau": self.tau}


def _places(beta: Array) -> tuple[Array, Array]:
    """(k,) logarithms of the rates over 1/tau, from the slowest, and the steps between them.

    d ln(rate)/dx goes from min((1 - beta)/beta, 1), in which the density's decay is even, to 1.
    """
    slope = jnp.minimum((1.0 - beta) / beta, 1.0)
    decay = (1.0 - beta) * beta ** (beta / (1.0 - beta))
    lowest = -(1.0 - beta) / beta * jnp.log(_CUT / decay) / slope
    x = lowest + (_FASTEST - lowest) * np.linspace(0.0, 1.0, _NODES)
    step = (_FASTEST - lowest) / (_NODES - 1)
    log_rates = slope * x + (1.0 - slope) * jax.nn.softplus(x)
    return log_rates, step * (slope + (1.0 - slope) * jax.nn.sigmoid(x))
