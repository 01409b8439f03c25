r"""Fluid pressure that drains at a rate that grows, or falls, with a power of the pressure.

.. math:: \frac{dp}{dt} = k v - \frac{p}{\tau} e^{-a \delta} \Big|\frac{p}{p_0}\Big|^n, \quad
          F = F_1 + p_n - p_{n=0}

F_1: the force by the list's law (n = 0); p_0: 5 % of the peak force, where tau is the time of
drainage whatever n. n = -1/2: the flow through an orifice; n > 0: pores that pressure opens. The
difference is taken over the platen's displacement. No factor over depth or clock can stand for it,
as the pressure remembers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qlvbayes.diagnosis.forms.otherform import SD, AbstractOtherForm, Shape, pairs
from qlvbayes.diagnosis.samples import Samples
from qlvbayes.inference.gaussnewton import Point, predict_along
from qlvbayes.law import touching
from qlvbayes.motion import Motion
from qlvbayes.records.record import Record
from qlvbayes.scales import SHARE
from qlvbayes.smoothmath import exp_slope

_FIELDS = ("k", "tau", "a")
_SUBSTEPS = 2  # between grid points
_LEAST = 1e-3  # of p_0: below, the rate of drainage changes no more (a power of 0 has no slope)


@dataclass(frozen=True, eq=False)
class PowerDrainage(AbstractOtherForm):
    """Fluid pressure with a power n of its own; see the module."""

    distant: ClassVar[bool] = True

    @property
    def sds(self) -> np.ndarray:
        """(1,) of the prior of n."""
        return np.array([SD])

    @property
    def reference(self) -> float:
        """p_0 (N)."""
        return SHARE * self.experiment.scales.force

    def combine(
        self, constants: np.ndarray, directions: np.ndarray, coefficients: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The list's law, and the difference that n makes."""
        record = self.ensemble.posterior.record
        listed, slopes = predict_along(self.ensemble, constants, directions)
        values = np.append(constants[self._places], coefficients)
        change, along = map(np.asarray, _change(record, values, self.reference, self._bonded))
        force, held = self._held(listed, change)
        own = slopes + np.tensordot(directions[:, self._places], along[:-1], 1)
        return force, np.concatenate([own, along[-1:]]) * held

    def predict(
        self, samples: Samples, constants: np.ndarray, coefficients: np.ndarray
    ) -> list[list[np.ndarray]]:
        """The list's law, and the difference that n makes."""
        values = np.concatenate([constants[:, self._places], coefficients], axis=1)
        found = []
        for listed, own in zip(samples.predict(constants), values, strict=True):
            change = np.asarray(_changes(samples.record, own, self.reference, self._bonded))
            found.append(
                [self._held(f, row[: f.size])[0] for f, row in zip(listed, change, strict=True)]
            )
        return found

    def least(self, point: Point) -> float:
        """0 or more: it always drains."""
        _, factors = np.transpose(self.shape(point).over_pressure)
        return float(factors.min() / factors.max())

    def is_typical(self, point: Point) -> bool:
        """The flow grows with the pressure."""
        return bool(point.theta[-1] > -1.0)

    def shape(self, point: Point) -> Shape:
        """How much faster than by the list's law it drains at five pressures up to the largest."""
        values = np.append(point.constants[self._places], point.theta[-1])
        record = self.ensemble.posterior.record
        largest = float(np.abs(_pressures(record, values, self.reference, self._bonded)).max())
        pressure = largest * np.linspace(0.2, 1.0, 5)
        factor = (pressure / self.reference) ** point.theta[-1]
        return Shape(self.effect, over_pressure=pairs(pressure, factor))

    @property
    def _places(self) -> list[int]:
        """Of k, tau and a among the constants."""
        return [self.ensemble.names.index(f"{self.effect}.{field}") for field in _FIELDS]

    @property
    def _bonded(self) -> bool:
        return bool(self.ensemble.posterior.model.bonded)

    def _held(self, listed: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force, and where the specimen is touched: there alone the pressure acts."""
        if self._bonded:
            return listed + change, np.ones(listed.shape, bool)
        held = (listed > 0.0) & (listed + change > 0.0)
        return np.where(listed > 0.0, np.maximum(listed + change, 0.0), listed), held


def drained_pressure(motion: Motion, values: Array, reference: float) -> Array:
    """Pressure (N,) in N at the grid points, of k, tau, a and n; the exponential midpoint rule."""
    k, tau, a, n = values

    def rate(pressure: Array, depth: Array) -> Array:
        size = jnp.hypot(pressure / reference, _LEAST)
        return jnp.exp(n * jnp.log(size) - a * depth) / tau

    def advance(pressure: Array, at: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        depth, travel, duration = at[0], at[1] / _SUBSTEPS, at[2] / _SUBSTEPS

        def after(share: float, decay: Array) -> Array:
            z = share * decay * duration
            return pressure * jnp.exp(-z) + share * k * travel * exp_slope(-z)

        for _ in range(_SUBSTEPS):
            halfway = after(0.5, rate(pressure, depth))
            pressure = after(1.0, rate(halfway, depth + 0.5 * travel))
            depth = depth + travel
        return pressure, pressure

    steps = motion.displacement[:-1], jnp.diff(motion.displacement), jnp.diff(motion.time)
    _, found = jax.lax.scan(advance, jnp.zeros(()), steps)
    return jnp.concatenate([jnp.zeros(1), found])


@partial(jax.jit, static_argnames="bonded")
def _pressures(record: Record, values: Array, reference: float, bonded: bool) -> Array:
    """(T, B) block means of the pressure."""

    def one(single: Record) -> Array:
        own = single.motion.alone
        motion = own if bonded else touching(own)
        return single.average(drained_pressure(motion, values, reference))

    return jax.vmap(one)(record)


@partial(jax.jit, static_argnames="bonded")
def _changes(record: Record, values: Array, reference: float, bonded: bool) -> Array:
    """(T, B) what n adds to the pressure by the list's law."""
    listed = jnp.asarray(values).at[-1].set(0.0)
    both = jnp.stack([jnp.asarray(values), listed])
    found = jax.vmap(lambda x: _pressures(record, x, reference, bonded))(both)
    return found[0] - found[1]


@partial(jax.jit, static_argnames="bonded")
def _change(record: Record, values: Array, reference: float, bonded: bool) -> tuple[Array, Array]:
    """The same, and its slopes (4, T, B)."""

    def changes(values: Array) -> Array:
        return _changes(record, values, reference, bonded)

    return changes(values), jnp.moveaxis(jax.jacfwd(changes)(values), -1, 0)
