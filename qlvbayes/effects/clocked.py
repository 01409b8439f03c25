"""What effects that go with the pad's clock have in common."""

from __future__ import annotations

from abc import abstractmethod

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion


class AbstractClocked(AbstractEffect):
    """An effect that changes the force by the time (s) since the pad's first test began."""

    @abstractmethod
    def at_clock(self, force: Array, clock: Array) -> Array:
        """What becomes of a force (N) at a time (s) of the pad's clock."""

    def force(self, below: Law, motion: Motion) -> Array:
        """The force of the law beneath, changed with the clock."""
        return self.at_clock(below.force(motion), motion.clock)

    def begin(self, below: Law, displacement: Array) -> State:
        """Beside the law's state the pad's clock, 0."""
        return below.begin(displacement), jnp.zeros_like(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """The force of the law beneath, changed with the clock."""
        inner, clock = state
        inner, force = below.step(inner, line)
        clock = clock + line.duration
        return (inner, clock), self.at_clock(force, clock)
