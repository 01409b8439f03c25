"""Weakly informative priors, scaled to what was measured."""

from __future__ import annotations

import math

from qlvbayes.elastic import AbstractElastic, Exponential, HertzPower, Linear
from qlvbayes.model import Model
from qlvbayes.noise import AbstractNoise, Correlated, StudentT, White
from qlvbayes.priors import Dirichlet, HalfNormal, LogNormal, Ordered
from qlvbayes.relaxation import Prony
from qlvbayes.scales import Scales, lognormal

LAWS = ("exponential", "linear", "hertz")
NOISES = ("correlated", "white", "student-t")


def default_model(
    scales: Scales, law: str = "exponential", modes: int = 2, *, bonded: bool = False
) -> Model:
    """QLV model with every constant free.

    m is within a factor 5 (one sd) of the record's secant stiffness, b of one over its depth;
    fractions are uniform on the simplex; rates are alike, log-normal, with the measurable range
    (one over the longest phase to one over the shortest interval) inside two sds.
    """
    rate = 1.0 / math.sqrt(scales.shortest * scales.longest)
    width = max(math.log(scales.longest / scales.shortest) / 4.0, 1.0)
    rates = Ordered(tuple(LogNormal(math.log(rate), width) for _ in range(modes)))
    return Model(_default_law(law, scales), Prony(Dirichlet([1.0] * (modes + 1)), rates), bonded)


def _default_law(law: str, scales: Scales) -> AbstractElastic:
    stiffness = lognormal(scales.force / scales.depth, 5.0)
    if law == "exponential":
        return Exponential(stiffness, lognormal(1.0 / scales.depth, 5.0))
    if law == "linear":
        return Linear(stiffness)
    if law == "hertz":
        return HertzPower(lognormal(scales.force / scales.depth**1.5, 5.0), lognormal(1.5, 1.3))
    raise ValueError(f"no elastic law {law!r}; choose one of {', '.join(LAWS)}")


def default_noise(scales: Scales, kind: str = "correlated") -> AbstractNoise:
    """Noise model with every scale free.

    The white sd is within a factor of 1.2 of the one measured inside holds without the model, or
    what the holds leave open if that is more; the correlated sd is half-normal, so that none at all
    is possible, and its time is within a factor of 3 of the measured one, or more likewise.
    """
    total = math.hypot(scales.white, scales.ou)
    if kind == "correlated":
        return Correlated(
            lognormal(scales.white, scales.white_factor),
            HalfNormal(3.0 * total),
            lognormal(scales.tau, scales.tau_factor),
        )
    if kind == "white":
        return White(lognormal(total, 3.0))
    if kind == "student-t":
        return StudentT(lognormal(total, 3.0), lognormal(8.0, 3.0))
    raise ValueError(f"no noise model {kind!r}; choose one of {', '.join(NOISES)}")
