"""Elastic laws: the force of an infinitely fast displacement, F_e(delta).

A new law is one class here: its fields are its constants (numbers, or priors while free), and
three methods give the force, the stiffness and the exact step of the hereditary integral.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.smoothmath import exp_difference_ratio, exp_growth, exp_slope


class AbstractElastic(eqx.Module):
    """What every elastic law offers; ``units`` names the kind of unit of each constant."""

    units: eqx.AbstractClassVar[dict[str, str]]

    @abstractmethod
    def force(self, depth: Array) -> Array:
        """F_e at ``depth`` (same shape), zero at zero depth."""

    @abstractmethod
    def stiffness(self, depth: Array) -> Array:
        """K = dF_e/d(depth)."""

    @abstractmethod
    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        r"""One step's part of a relaxing mode, for depth linear in time over the step.

        .. math:: \int_0^h e^{-v (h - s)} K(\delta(s)) \dot\delta \, ds

        ``start``, ``stop``: depths at both ends; ``force_start``, ``force_stop``: F_e there
        (known to the caller, who needs them anyway); ``decay``: v h >= 0.
        """


class Exponential(AbstractElastic):
    """F_e = (m/b)(e^{b delta} - 1), the paper's Eq. 8; linear, m delta, at b = 0.

    m: initial stiffness (N/mm); b: stiffening (1/mm).
    """

    m: Any
    b: Any
    units: ClassVar[dict[str, str]] = {"m": "stiffness", "b": "exponent"}

    def force(self, depth: Array) -> Array:
        """(m/b)(e^{b depth} - 1)."""
        return self.m * exp_growth(depth, self.b)

    def stiffness(self, depth: Array) -> Array:
        """K = m e^{b depth}."""
        return self.m * jnp.exp(self.b * depth)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Exact: m dd (e^{b d1} - e^{b d0 - v h}) / (b dd + v h)."""
        travel = stop - start
        stiffness_start = (self.m + self.b * force_start) * jnp.exp(-decay)
        stiffness_stop = self.m + self.b * force_stop
        return travel * exp_difference_ratio(
            stiffness_stop, stiffness_start, self.b * travel + decay
        )


class Linear(AbstractElastic):
    """F_e = m delta (m in N/mm): the linear viscoelastic solid."""

    m: Any
    units: ClassVar[dict[str, str]] = {"m": "stiffness"}

    def force(self, depth: Array) -> Array:
        """F_e = m depth."""
        return self.m * depth

    def stiffness(self, depth: Array) -> Array:
        """K = m, at any depth."""
        return self.m * jnp.ones_like(depth)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Exact: m dd (1 - e^{-v h})/(v h)."""
        return self.m * (stop - start) * exp_slope(-decay)


class HertzPower(AbstractElastic):
    """F_e = m delta^n; n = 3/2 is Hertz's contact of a sphere on a flat (1882).

    m: force at 1 mm (N/mm^n); n: exponent, above 1. Odd in the depth. The hereditary step has no
    closed form; it is integrated with the Prony exponential taken exactly and the force F_e
    taken as quadratic over the step; the error falls at least as the square of the step.
    """

    m: Any
    n: Any
    units: ClassVar[dict[str, str]] = {"m": "power_stiffness", "n": "fraction"}

    def force(self, depth: Array) -> Array:
        """F_e = m depth^n, odd in depth."""
        size = jnp.abs(depth)
        inside = jnp.where(size > 0.0, size, 1.0)
        return jnp.where(size > 0.0, self.m * jnp.sign(depth) * inside**self.n, 0.0)

    def stiffness(self, depth: Array) -> Array:
        """K = m n depth^(n-1)."""
        size = jnp.abs(depth)
        inside = jnp.where(size > 0.0, size, 1.0)
        return jnp.where(size > 0.0, self.m * self.n * inside ** (self.n - 1.0), 0.0)

    def relaxed_step(
        self, start: Array, stop: Array, force_start: Array, force_stop: Array, decay: Array
    ) -> Array:
        """Force quadratic over the step (both ends and the middle), Prony exponential exact."""
        middle = self.force(0.5 * (start + stop))
        return quadratic_force_step(force_start, middle, force_stop, decay)


def quadratic_force_step(f0: Array, fm: Array, f1: Array, decay: Array) -> Array:
    """Integral of e^{-decay(1-s)} dF/ds over s in (0,1), F quadratic through f0, fm, f1."""
    slope = 4.0 * fm - 3.0 * f0 - f1
    bend = 4.0 * (f0 + f1 - 2.0 * fm)
    first = exp_slope(-decay)
    return slope * first + bend * _first_moment(decay)


def _first_moment(x: Array) -> Array:
    """Integral of s e^{-x(1-s)} over (0,1): (1 - (1 - e^{-x})/x)/x, 1/2 at x = 0."""
    near = x < 0.3
    close = jnp.where(near, x, 0.0)
    far = jnp.where(near, 1.0, x)
    series = jnp.full_like(close, 1.0 / 15)
    for k in range(14, 1, -1):
        series = (1.0 - close * series) / k
    return jnp.where(near, series, (1.0 - exp_slope(-far)) / far)
