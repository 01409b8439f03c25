"""Define the elastic law that is a polynomial of three terms."""

from __future__ import annotations

from typing import ClassVar, Self

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import Normal
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array


class Cubic(AbstractElastic):
    """Elastic force as a cubic polynomial: F_e = m delta + k2 delta^2 + k3 delta^3.

    Parameters
    ----------
    m
        Stiffness at first contact (N/mm).
    k2, k3
        Coefficients of the square (N/mm2) and of the cube (N/mm3) of depth, of either sign.

    References
    ----------
    Rivlin & Saunders 1951, doi:10.1098/rsta.1951.0004
    """

    m: Constant
    k2: Constant
    k3: Constant
    name: ClassVar[str] = "polynomial:3"
    units: ClassVar[dict[str, str]] = {
        "m": "stiffness",
        "k2": "quadratic_stiffness",
        "k3": "cubic_stiffness",
    }
    meanings: ClassVar[dict[str, str]] = {
        "m": "stiffness at first contact, before anything relaxes",
        "k2": "force by the square of depth",
        "k3": "force by the cube of depth",
    }
    law: ClassVar[str] = "F(δ) = m δ + k2 δ² + k3 δ³"
    reference: ClassVar[str] = "Rivlin & Saunders 1951, doi:10.1098/rsta.1951.0004"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the law under weak priors: m near the secant stiffness, k2 and k3 around zero."""
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        second, third = scales.force / scales.depth**2, scales.force / scales.depth**3
        return cls(stiffness, Normal(0.0, second), Normal(0.0, third))

    def force(self, depth: Array) -> Array:
        """Return F_e = m depth + k2 depth^2 + k3 depth^3."""
        return depth * (self.m + depth * (self.k2 + self.k3 * depth))

    def stiffness(self, depth: Array) -> Array:
        """Return K = m + 2 k2 depth + 3 k3 depth^2."""
        return self.m + depth * (2.0 * self.k2 + 3.0 * self.k3 * depth)

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        """Return dd (K(d0) + K'(d0) dd s + 3 k3 dd^2 s^2)."""
        travel = stop - start
        slope = 2.0 * self.k2 + 6.0 * self.k3 * start
        bend = 3.0 * self.k3 * travel**3
        return Rise((travel * self.stiffness(start), slope * travel**2, bend))
