"""Define the elastic law that is a polynomial of two terms."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import Normal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Quadratic(AbstractElastic):
    """Elastic force as a polynomial of two terms: F_e = m delta + k2 delta^2.

    Parameters
    ----------
    m
        Stiffness at first contact (N/mm).
    k2
        Coefficient of the square of depth (N/mm2); the pad stiffens where it is positive.

    References
    ----------
    Rivlin & Saunders 1951, doi:10.1098/rsta.1951.0004
    """

    m: Constant
    k2: Constant
    name: ClassVar[str] = "polynomial:2"
    units: ClassVar[dict[str, str]] = {"m": "stiffness", "k2": "quadratic_stiffness"}
    meanings: ClassVar[dict[str, str]] = {
        "m": "stiffness at first contact, before anything relaxes",
        "k2": "force by the square of depth",
    }
    law: ClassVar[str] = "F(δ) = m δ + k2 δ²"
    reference: ClassVar[str] = "Rivlin & Saunders 1951, doi:10.1098/rsta.1951.0004"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors: m near the secant stiffness, k2 around zero."""
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        return cls(stiffness, Normal(0.0, scales.force / scales.depth**2))

    def force(self, depth: Array) -> Array:
        """Return F_e = m depth + k2 depth^2."""
        return depth * (self.m + self.k2 * depth)

    def stiffness(self, depth: Array) -> Array:
        """Return K = m + 2 k2 depth."""
        return self.m + 2.0 * self.k2 * depth

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        """Return dd (K(d0) + 2 k2 dd s)."""
        travel = stop - start
        return Rise((travel * self.stiffness(start), 2.0 * self.k2 * travel**2))
