"""Play between the encoder and the platen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Self

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales


class Backlash(AbstractEffect):
    r"""Depth p with p = min(max(p_before, d), d + play): the platen waits when the drive turns.

    play: way that the drive turns back before the platen follows (mm), zero or more. Going in, the
    platen is where the encoder says. This is the operator of play.
    """

    play: Any
    name: ClassVar[str] = "backlash"
    level: ClassVar[Level] = Level.DEPTH
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {"play": "displacement"}
    null: ClassVar[dict[str, float]] = {"play": 0.0}
    inverts: ClassVar[bool] = False
    not_inverted: ClassVar[str] = "while the platen waits the drive may be anywhere in the play"
    law: ClassVar[str] = "delta -> p, p' = 0 until delta leaves [p - play, p]"
    seen: ClassVar[str] = "after each turn of the drive the force waits before it follows"
    reference: ClassVar[str] = "Visintin 1994, doi:10.1007/978-3-662-11557-2, ch. III, play"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Play scaled by the stiffness at the largest force."""
        return cls(scales.positive(scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        """Let the platen wait."""
        place, _ = jax.lax.associative_scan(_then, self._range(motion.displacement))
        waits = self._waits(place, motion.displacement)
        still = jnp.zeros_like(place)
        followed = replace(
            motion,
            displacement=place,
            velocity=jnp.where(waits, still, motion.velocity),
            acceleration=jnp.where(waits, still, motion.acceleration),
            bow=None if motion.bow is None else jnp.where(waits, still, motion.bow),
        )
        return below.force(followed)

    def begin(self, below: Law, displacement: Array) -> State:
        """Beside the law's state the platen's place."""
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Let the platen wait, then go with the drive."""
        inner, place = state
        place = jnp.clip(place, line.displacement, line.displacement + self.play)
        waits = self._waits(place, line.displacement)
        speed = jnp.where(waits, 0.0, line.velocity)
        inner, force = below.step(inner, replace(line, displacement=place, velocity=speed))
        return (inner, place), force

    def _range(self, depth: Array) -> tuple[Array, Array]:
        """Lower and upper end (N,) of where the platen may be at each point; one at the first."""
        return depth, jnp.concatenate([depth[:1], depth[1:] + self.play])

    def _waits(self, place: Array, depth: Array) -> Array:
        """Whether the play is neither used up on the way in nor on the way back."""
        return (place > depth) & (place < depth + self.play)  # exact: it is brought to these

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """It needs a test that moves back."""
        return None if protocol.unloads else "no test unloads"


def _then(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Two ranges into which a place is brought one after the other, as one range."""
    low, high = second
    return jnp.clip(first[0], low, high), jnp.clip(first[1], low, high)
