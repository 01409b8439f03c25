"""Elastic forces that are polynomials of depth, of one, two and three terms, or one power."""

from __future__ import annotations

from typing import Self

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.elastic.steps import Rise
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import Normal
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class Polynomial(AbstractElastic):
    """Elastic force F_e = m delta + k2 delta^2 + k3 delta^3, with one to three of the terms.

    Each step's integral is exact: along a step the stiffness is a polynomial of the share of the
    step that is done. The coefficients are in N/mm, N/mm2 and N/mm3.
    """

    m: Constant = constant("stiffness", "stiffness at first contact, before anything relaxes")
    reference = "Rivlin & Saunders 1951, doi:10.1098/rsta.1951.0004"

    @property
    def terms(self) -> tuple[Array, Array]:
        """Return k2 and k3, 0 where the law has no such term."""
        return getattr(self, "k2", 0.0), getattr(self, "k3", 0.0)

    @classmethod
    def default(cls, scales: Scales) -> Self:
        stiffness = lognormal(scales.force / scales.depth, 5.0)
        others = [Normal(0.0, scales.force / scales.depth**k) for k in range(2, len(cls.units) + 1)]
        return cls(stiffness, *others)

    def force(self, depth: Array) -> Array:
        second, third = self.terms
        return depth * (self.m + depth * (second + third * depth))

    def stiffness(self, depth: Array) -> Array:
        second, third = self.terms
        return self.m * xp.ones_like(depth) + depth * (2.0 * second + 3.0 * third * depth)

    def rise(self, start: Array, stop: Array, force_start: Array, force_stop: Array) -> Rise:
        """Return dd (K(d0) + K'(d0) dd s + 3 k3 dd^2 s^2)."""
        (second, third), travel = self.terms, stop - start
        slope, bend = 2.0 * second + 6.0 * third * start, 3.0 * third * travel
        powers = travel * self.stiffness(start), travel * travel * slope, travel * travel * bend
        return Rise(powers[: len(self.units)])


class Linear(Polynomial):
    """Elastic force proportional to depth, F_e = m delta: a linear viscoelastic solid."""

    m: Constant = constant("stiffness", "stiffness before anything relaxes, at any depth")
    name = "linear"
    law = "K(δ) = m"
    reference = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"


class Quadratic(Polynomial):
    """Elastic force as a polynomial of two terms: F_e = m delta + k2 delta^2."""

    k2: Constant = constant("quadratic_stiffness", "force by the square of depth")
    name = "polynomial:2"
    law = "F(δ) = m δ + k2 δ²"


class Cubic(Quadratic):
    """Elastic force as a cubic polynomial: F_e = m delta + k2 delta^2 + k3 delta^3."""

    k3: Constant = constant("cubic_stiffness", "force by the cube of depth")
    name = "polynomial:3"
    law = "F(δ) = m δ + k2 δ² + k3 δ³"


class HertzPower(AbstractElastic):
    """Elastic force as a power of depth: F_e = m delta^n.

    A sphere on a flat has n = 3/2 (Hertz). The force is odd in the depth. The hereditary step has
    no closed form: the exponential of each relaxation mode is integrated exactly against a force
    that is quadratic over the step, with an error that falls at least as the square of the step.
    """

    m: Constant = constant("power_stiffness", "force at a depth of 1, before anything relaxes")
    n: Constant = constant("fraction", "the force grows with this power of depth")
    name = "hertz"
    law = "F(δ) = m δ^n, a power law"
    reference = "Hertz 1882, doi:10.1515/crll.1882.92.156"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(lognormal(scales.force / scales.depth**1.5, 5.0), lognormal(1.5, 1.3))

    def force(self, depth: Array) -> Array:
        size = xp.abs(depth)
        inside = xp.where(size > 0.0, size, 1.0)
        return xp.where(size > 0.0, self.m * xp.sign(depth) * inside**self.n, 0.0)

    def stiffness(self, depth: Array) -> Array:
        size = xp.abs(depth)
        inside = xp.where(size > 0.0, size, 1.0)
        return xp.where(size > 0.0, self.m * self.n * inside ** (self.n - 1.0), 0.0)
