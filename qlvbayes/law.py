"""The force law that an effect wraps: the material, and the effects beneath."""

from __future__ import annotations

from typing import Protocol

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.hereditary import hereditary_force
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.motion import Motion


class Layer(Protocol):
    """What wraps a law: it gets the motion and the law beneath and returns a force."""

    def force(self, below: Law, motion: Motion) -> Array:
        """Force (N,) in N at the motion's grid points."""
        ...


class Law(eqx.Module):
    """QLV material under some layers, the outermost last.

    A layer asks ``below.force(motion)`` for the force beneath it, of this motion or of another one,
    and may look at ``below.elastic`` and ``below.relaxation``.
    """

    elastic: AbstractElastic
    relaxation: AbstractRelaxation
    layers: tuple[Layer, ...] = ()

    def force(self, motion: Motion) -> Array:
        """Force (N,) in N; every constant must be a number."""
        if self.layers:
            below = Law(self.elastic, self.relaxation, self.layers[:-1])
            return self.layers[-1].force(below, motion)
        return hereditary_force(self.elastic, self.relaxation, motion.time, motion.displacement)


class Contact(eqx.Module):
    """A loose specimen: not touched at negative displacement, and its force is never negative."""

    def force(self, below: Law, motion: Motion) -> Array:
        """max(F, 0)."""
        return jnp.maximum(below.force(touching(motion)), 0.0)


def touching(motion: Motion) -> Motion:
    """The specimen's own motion: depth max(displacement, 0), at rest while not touched."""
    return at_depth(motion, motion.displacement)


def at_depth(motion: Motion, displacement: Array) -> Motion:
    """``motion`` with the depth max(displacement, 0), at rest where that is 0."""
    contact = displacement > 0.0
    return Motion(
        motion.time,
        jnp.where(contact, displacement, 0.0),
        jnp.where(contact, motion.velocity, 0.0),
        jnp.where(contact, motion.acceleration, 0.0),
        motion.start,
        motion.ago,
    )
