"""Weakly informative priors, scaled to what was measured."""

from __future__ import annotations

import math

from qlvbayes.laws.catalogue import LAWS, Laws, find_elastic, find_relaxation
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.model.model import Model
from qlvbayes.model.noise import AbstractNoise, Correlated, Floor, StudentT, White
from qlvbayes.priors import HalfNormal

NOISES = ("floor", "correlated", "white", "student-t")


def default_model(
    scales: Scales,
    law: str = "exponential",
    modes: int = 2,
    *,
    relaxation: str = "prony",
    laws: Laws = LAWS,
    bonded: bool = False,
) -> Model:
    """QLV model with every constant free, each law under its own default priors.

    law, relaxation: names of an elastic law and of a relaxation among ``laws``; modes: of a Prony
    series. Raises InputError where there is no law of that name.
    """
    elastic = find_elastic(law, laws).default(scales)
    kind = find_relaxation(relaxation, laws)
    relaxing = Prony.of_modes(scales, modes) if kind is Prony else kind.default(scales)
    return Model(elastic, relaxing, bonded)


def default_noise(scales: Scales, kind: str = "floor") -> AbstractNoise:
    """Noise model: the measured floor, or one with every scale free.

    The free white sd is within a factor of 1.2 of the one measured inside holds without the model,
    or what the holds leave open if that is more; the correlated sd is half-normal, so that none at
    all is possible, and its time is within a factor of 3 of the measured one, or more likewise.
    """
    if kind == "floor":
        return Floor(*5 * [math.nan])
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
