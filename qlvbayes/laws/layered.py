"""Define the force law that an effect wraps: the material and the effects beneath it."""

from __future__ import annotations

from typing import Any, Protocol

from qlvbayes import xp
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.hereditary import at_first, hereditary_force, hereditary_step
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.law import AbstractRelaxation
from qlvbayes.pytree import Pytree, static
from qlvbayes.xp import Array

State = Any
"""The state of a law between two steps: nested tuples of arrays."""


class Layer(Protocol):
    """Layer around a law: it takes the motion and the law beneath and returns a force."""

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force (N,) in N at the motion's grid points."""
        ...

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of this layer and of the law beneath at a motion's first point."""
        ...

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force (N) at the end of a line."""
        ...


class Law(Pytree):
    """Quasi-linear viscoelastic material under some layers, the outermost last.

    A layer calls ``below.force(motion)`` for the force beneath it, of this motion or of a changed
    one, and may use ``below.elastic`` and ``below.relaxation``. ``begin`` and ``step`` give the
    same force line by line.
    """

    elastic: AbstractElastic
    relaxation: AbstractRelaxation
    layers: tuple[Layer, ...] = ()

    def force(self, motion: Motion) -> Array:
        """Return the force (N,) in N; every constant must be a number."""
        if self.layers:
            return self.layers[-1].force(self._below, motion)
        path = motion.time, motion.displacement, motion.sagitta
        return hereditary_force(self.elastic, self.relaxation, *path)

    def begin(self, displacement: Array) -> State:
        """Return the state at the first point of a motion, at ``displacement`` (mm)."""
        if self.layers:
            return self.layers[-1].begin(self._below, displacement)
        return at_first(self.elastic, self.relaxation, displacement)

    def step(self, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force (N) at the end of the next line."""
        if self.layers:
            return self.layers[-1].step(self._below, state, line)
        return hereditary_step(
            self.elastic, self.relaxation, state, line.duration, line.displacement
        )

    @property
    def _below(self) -> Law:
        return Law(self.elastic, self.relaxation, self.layers[:-1])


class Contact(Pytree):
    """Contact of a loose specimen: it is untouched at negative displacement and cannot pull.

    Where ``followed`` is true, steps give the force that a platen stuck to the specimen would feel.
    That force rises with displacement everywhere and so has an inverse.
    """

    followed: bool = static(default=False)

    def force(self, below: Law, motion: Motion) -> Array:
        """Return max(F, 0)."""
        return xp.maximum(below.force(touching(motion)), 0.0)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath at the specimen's depth, max(displacement, 0)."""
        return below.begin(xp.maximum(displacement, 0.0))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return max(F, 0); where followed, F less the elastic force at the depth of the gap."""
        depth = line_at_depth(line, line.displacement)
        state, force = below.step(state, depth)
        if not self.followed:
            return state, xp.maximum(force, 0.0)
        return state, force - below.elastic.force(xp.asarray(depth.clear))


def touching(motion: Motion) -> Motion:
    """Return the specimen's own motion: depth max(displacement, 0), at rest while untouched."""
    return at_depth(motion, motion.displacement)


def at_depth(motion: Motion, displacement: Array) -> Motion:
    """Return ``motion`` with the depth max(displacement, 0), at rest where that is 0."""
    contact = displacement > 0.0
    depth = xp.where(contact, displacement, 0.0)
    return motion.followed(depth, lambda rate: xp.where(contact, rate, 0.0))


def line_at_depth(line: Line, displacement: Array) -> Line:
    """Return ``line`` to the depth max(displacement, 0), at rest where that is 0."""
    contact = displacement > 0.0
    return Line(
        line.duration,
        xp.where(contact, displacement, 0.0),
        xp.where(contact, line.velocity, 0.0),
        line.clear + xp.maximum(-displacement, 0.0),
    )
