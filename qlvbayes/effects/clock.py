"""Define the common base of effects that change the force with the pad's clock."""

from __future__ import annotations

from abc import abstractmethod

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.xp import Array


class AbstractClocked(AbstractEffect):
    """Effect that depends on the time (s) since the pad's first test began."""

    @abstractmethod
    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return what a force (N) becomes at a time (s) of the pad's clock."""

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath, changed with the clock."""
        return self.at_clock(below.force(motion), motion.clock)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the pad's clock, 0."""
        return below.begin(displacement), xp.zeros_like(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state, and the force of the law beneath, changed with the clock."""
        inner, clock = state
        inner, force = below.step(inner, line)
        clock = clock + line.duration
        return (inner, clock), self.at_clock(force, clock)
