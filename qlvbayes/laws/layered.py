"""The force law that an effect wraps: the material, and the effects beneath."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.hereditary import at_first, hereditary_force, hereditary_step
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.law import AbstractRelaxation

State = Any
"""What a law remembers between two steps: nested tuples of arrays."""


class Layer(Protocol):
    """What wraps a law: it gets the motion and the law beneath and returns a force."""

    def force(self, below: Law, motion: Motion) -> Array:
        """Force (N,) in N at the motion's grid points."""
        ...

    def begin(self, below: Law, displacement: Array) -> State:
        """The state at a motion's first point, of this layer and of the law beneath."""
        ...

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """State and force (N) at the end of a line."""
        ...


class Law(eqx.Module):
    """QLV material under some layers, the outermost last.

    A layer asks ``below.force(motion)`` for the force beneath it, of this motion or of another one,
    and may look at ``below.elastic`` and ``below.relaxation``. ``begin`` and ``step`` give the same
    force line by line.
    """

    elastic: AbstractElastic
    relaxation: AbstractRelaxation
    layers: tuple[Layer, ...] = ()

    def force(self, motion: Motion) -> Array:
        """Force (N,) in N; every constant must be a number."""
        if self.layers:
            return self.layers[-1].force(self._below, motion)
        path = motion.time, motion.displacement, motion.bow
        return hereditary_force(self.elastic, self.relaxation, *path)

    def begin(self, displacement: Array) -> State:
        """The state at the first point of a motion, at ``displacement`` (mm)."""
        if self.layers:
            return self.layers[-1].begin(self._below, displacement)
        return at_first(self.elastic, self.relaxation, displacement)

    def step(self, state: State, line: Line) -> tuple[State, Array]:
        """State and force (N) at the end of the next line."""
        if self.layers:
            return self.layers[-1].step(self._below, state, line)
        return hereditary_step(
            self.elastic, self.relaxation, state, line.duration, line.displacement
        )

    @property
    def _below(self) -> Law:
        return Law(self.elastic, self.relaxation, self.layers[:-1])


class Contact(eqx.Module):
    """A loose specimen: not touched at negative displacement, and its force is never negative.

    followed: whether steps tell the force that a platen stuck to the specimen would feel, which
    rises with displacement everywhere and so has an inverse.
    """

    followed: bool = eqx.field(static=True, default=False)

    def force(self, below: Law, motion: Motion) -> Array:
        """max(F, 0)."""
        return jnp.maximum(below.force(touching(motion)), 0.0)

    def begin(self, below: Law, displacement: Array) -> State:
        """Of the specimen's depth."""
        return below.begin(jnp.maximum(displacement, 0.0))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """max(F, 0); where followed F, and above the specimen less its elastic law's force."""
        depth = line_at_depth(line, line.displacement)
        state, force = below.step(state, depth)
        if not self.followed:
            return state, jnp.maximum(force, 0.0)
        return state, force - below.elastic.force(jnp.asarray(depth.clear))


def touching(motion: Motion) -> Motion:
    """The specimen's own motion: depth max(displacement, 0), at rest while not touched."""
    return at_depth(motion, motion.displacement)


def at_depth(motion: Motion, displacement: Array) -> Motion:
    """``motion`` with the depth max(displacement, 0), at rest where that is 0."""
    contact = displacement > 0.0
    return replace(
        motion,
        displacement=jnp.where(contact, displacement, 0.0),
        velocity=jnp.where(contact, motion.velocity, 0.0),
        acceleration=jnp.where(contact, motion.acceleration, 0.0),
        bow=None if motion.bow is None else jnp.where(contact, motion.bow, 0.0),
    )


def line_at_depth(line: Line, displacement: Array) -> Line:
    """``line`` to the depth max(displacement, 0), at rest where that is 0."""
    contact = displacement > 0.0
    return Line(
        line.duration,
        jnp.where(contact, displacement, 0.0),
        jnp.where(contact, line.velocity, 0.0),
        line.clear + jnp.maximum(-displacement, 0.0),
    )
