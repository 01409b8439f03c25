"""Trapped fluid: its pressure drains linearly or by a power law."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import fading, material_duration, material_time, resolved_times
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.recursion import drained
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.priors import HalfNormal, LogUniform, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class FluidPressure(AbstractEffect):
    """Pressure of trapped fluid: F = F_below + p, dp/dt = k v - (p/tau) e^{-a d}, p(0) = 0.

    In the time xi = int e^{-a d} dt this is one relaxing mode.
    """

    k: Constant = constant("stiffness", "undrained stiffness, zero or more")
    tau: Constant = constant("time", "time of drainage at zero depth")
    a: Constant = constant("exponent", "how compression closes the pores")
    name = "fluid_pressure"
    level = Level.ADDING
    rank = 3
    law = "dp/dt = k v - (p/tau) e^(-a delta), F += p"
    seen = "a transient after each move, slower to die the deeper it is"
    reference = "Lai, Mow & Roth 1981, doi:10.1115/1.3138261"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        low, high = resolved_times(scales)
        return cls(
            scales.positive(scales.depth), LogUniform(low, high), HalfNormal(1.0 / scales.depth)
        )

    def force(self, below: Law, motion: Motion) -> Array:
        own = motion.alone
        xi = material_time(own.time, own.displacement, -self.a)
        depth = own.displacement - own.displacement[0]
        pressure = hereditary_force(*self._drainage, xi, depth, own.sagitta)
        return below.force(motion) + pressure

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), Relaxing(displacement, np.zeros(1))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, own = state
        inner, force = below.step(inner, line)
        xi_step = material_duration(line.duration, own.depth, line.displacement, -self.a)
        own, pressure = hereditary_step(*self._drainage, own, xi_step, line.displacement)
        return (inner, own), force + pressure

    @property
    def _drainage(self) -> tuple[Linear, Prony]:
        return fading(self.k, 1.0 / self.tau)


_NONE = 1e-12  # share of the stroke below which the power is replaced by a straight line
_NEAR = 1e-5  # relative gap, below which a secant is the tangent in its middle to 1e-10
_POWERS = (0.25, 4.0)  # bounds of m: 1/2 to 2 for n = 3, 1 for 2; beyond, rho hardly changes


class PowerLawDrainage(FluidPressure):
    """Pressure that drains as a power of itself: F = F_below + k q.

    It follows dq/dt = v - (q/tau) abs(q/stroke)^{n-1} e^{-a d}, q(0) = 0. A shear-thinning fluid
    seeps as a power of the pressure, and the last of it stays long.
    """

    tau: Constant = constant(
        "time", "time in which, at zero depth, the pressure of an undrained ``stroke`` drains"
    )
    n: Constant = constant("fraction", "exponent, from 1 (Darcy's flow) to 3")
    stroke: Constant = constant("displacement", "reference compression, which is fixed")
    name = "power_law_drainage"
    generalises = FluidPressure.name
    reduces: ClassVar[dict[str, float]] = {"n": 1.0}
    law = "dq/dt = v - (q/tau) |q/stroke|^(n-1) e^(-a delta), F += k q"
    seen = "a transient after each move, fast at first, with a long tail"
    reference = "Christopher & Middleman 1965, Ind. Eng. Chem. Fundam. 4:422"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        linear = FluidPressure.default(scales)
        return cls(linear.k, linear.tau, linear.a, Uniform(1.0, 3.0), scales.depth)

    def force(self, below: Law, motion: Motion) -> Array:
        own = motion.alone
        step = xp.diff(material_time(own.time, own.displacement, -self.a))
        points = (step, *self._balance(step, xp.diff(own.displacement)))
        constants, bounds = (self.tau, self.n, self.stroke), (_NONE, _NEAR, *_POWERS)
        if (q := drained(points, constants, bounds)) is None:
            q = xp.concatenate([np.zeros(1), xp.recur(self._drained, np.zeros(()), points)])
        return below.force(motion) + self.k * q

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), displacement, xp.zeros_like(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, depth, q = state
        inner, force = below.step(inner, line)
        xi_step = material_duration(line.duration, depth, line.displacement, -self.a)
        q = self._drained(q, (xi_step, *self._balance(xi_step, line.displacement - depth)))
        return (inner, line.displacement, q), force + self.k * q

    def _rate(self, q: Array) -> Array:
        """Return r(q)/q of dq/dxi = s - r(q), r = (q/tau) abs(q/stroke)^{n-1}."""
        return xp.maximum(xp.abs(q) / self.stroke, _NONE) ** (self.n - 1.0) / self.tau

    def _balance(self, step: Array, travel: Array) -> tuple[Array, Array, Array, Array]:
        """Return jump, s = dd/dxi, q* and rho* of steps in xi, which do not depend on q."""
        lasting = step > 0.0
        source = xp.where(lasting, travel / xp.where(lasting, step, 1.0), 0.0)
        size = xp.maximum(xp.abs(source) * self.tau / self.stroke, _NONE**self.n)
        balance = xp.sign(source) * self.stroke * size ** (1.0 / self.n)
        balance = xp.where(source == 0.0, 0.0, balance)
        return xp.where(lasting, 0.0, travel), source, balance, self.n * self._rate(balance)

    def _drained(self, q: Array, point: tuple[Array, ...]) -> Array:
        """Return q after a step."""
        step, jump, source, balance, settling = point
        q = q + jump
        relative = self._rate(q)
        gap = q - balance
        near = xp.abs(gap) <= _NEAR * (xp.abs(q) + xp.abs(balance))
        secant = (relative * q - source) / xp.where(near, 1.0, gap)
        secant = xp.where(near, self.n * self._rate(0.5 * (q + balance)), secant)
        excess = secant - settling
        curved = xp.abs(excess) > _NEAR * secant
        power = (self.n * relative - secant) / xp.where(curved, excess, 1.0)
        power = xp.clip(xp.where(curved, power, 1.0), *_POWERS)
        grown = power * excess * step * exp_slope(-power * settling * step)
        decay = settling * step + xp.log1p(grown) / power
        share = xp.where(secant > 0.0, -xp.expm1(-decay) / secant, step)
        return q + (source - relative * q) * share
