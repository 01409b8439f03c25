"""Define prior densities of constants, and maps from unconstrained numbers to their supports."""

from qlvbayes.priors.distributions import (
    AbstractPositivePrior,
    AbstractPrior,
    AbstractScalarPrior,
    Constant,
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    Uniform,
)
from qlvbayes.priors.joint import Dirichlet, Ordered

__all__ = [
    "AbstractPositivePrior",
    "AbstractPrior",
    "AbstractScalarPrior",
    "Constant",
    "Dirichlet",
    "HalfNormal",
    "LogNormal",
    "LogUniform",
    "Normal",
    "Ordered",
    "Uniform",
]
