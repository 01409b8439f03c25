"""Define the relaxation law that is a power of time, and begins at 1."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.laws.relaxation.law import AbstractRelaxation, decades_of, middle_of, shared_out
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogNormal, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import static
from qlvbayes.xp import Array

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
