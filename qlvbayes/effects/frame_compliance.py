"""The rig gives way in proportion to force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales

_STEPS = 4  # of a Newton iteration whose slope is right to a few per cent


class FrameCompliance(AbstractEffect):
    """Depth = displacement - compliance F, F the force itself.

    compliance (mm/N): one over the frame's stiffness, zero or more. Solved at all grid points at
    once by quasi-Newton steps with the instantaneous elastic stiffness, four steps to 1e-5 of the
    peak for a frame ten times as stiff as the pad. The frame's own speed is neglected against the
    platen's.
    """

    compliance: Any
    name: ClassVar[str] = "frame_compliance"
    level: ClassVar[Level] = Level.FRAME
    units: ClassVar[dict[str, str]] = {"compliance": "compliance"}
    null: ClassVar[dict[str, float]] = {"compliance": 0.0}
    costly: ClassVar[bool] = True
    law: ClassVar[str] = "delta -> delta - compliance F"
    seen: ClassVar[str] = "softer in proportion to force"
    reference: ClassVar[str] = "Oliver & Pharr 1992, doi:10.1557/JMR.1992.1564"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Compliance scaled by peak force and twice the secant stiffness."""
        return cls(scales.positive(2.0 * scales.force**2 / scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        """Iterate F = below(displacement - compliance F)."""
        return balanced(below, motion, self._yielding)

    def begin(self, below: Law, displacement: Array) -> State:
        """A state of the law for each of Newton's steps."""
        return balanced_begin(below, displacement, self._yielding)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Iterate F = below(displacement - compliance F)."""
        return balanced_step(below, state, line, self._yielding)

    def _yielding(self, force: Array) -> tuple[Array, Array]:
        return self.compliance * force, self.compliance


Yielding = Callable[[Array], tuple[Array, Array]]
"""Deflection and compliance of a frame at a force."""


def balanced(below: Law, motion: Motion, yielding: Yielding) -> Array:
    """Force (N,) of a pad in a frame.

    Newton's steps take the instantaneous elastic stiffness for the pad's own.
    """
    force = jnp.zeros_like(motion.time)
    for _ in range(_STEPS):  # no scan: the law beneath runs in pieces of its own
        depth, slope = _given_way(below, motion.displacement, force, yielding)
        answer = below.force(replace(motion, displacement=depth))
        force = (answer + slope * force) / (1.0 + slope)
    return force


def balanced_begin(below: Law, displacement: Array, yielding: Yielding) -> tuple[State, ...]:
    """A state of the law beneath for each of Newton's steps, each of which has its own motion."""
    zero = jnp.zeros_like(displacement)
    force, states = zero, []
    for _ in range(_STEPS):
        depth, slope = _given_way(below, displacement, force, yielding)
        states.append(below.begin(depth))
        _, answer = below.step(states[-1], Line(zero, depth, zero))
        force = (answer + slope * force) / (1.0 + slope)
    return tuple(states)


def balanced_step(
    below: Law, states: State, line: Line, yielding: Yielding
) -> tuple[tuple[State, ...], Array]:
    """States and force (N) of a pad in a frame after a line, by the steps of `balanced`."""
    force, moved = jnp.zeros_like(line.displacement), []
    for state in states:
        depth, slope = _given_way(below, line.displacement, force, yielding)
        state, answer = below.step(state, replace(line, displacement=depth))
        moved.append(state)
        force = (answer + slope * force) / (1.0 + slope)
    return tuple(moved), force


def _given_way(
    below: Law, displacement: Array, force: Array, yielding: Yielding
) -> tuple[Array, Array]:
    """Depth once the frame has given way to a force, and its slope times the pad's stiffness."""
    deflection, compliance = yielding(force)
    depth = displacement - deflection
    return depth, compliance * below.elastic.stiffness(depth)
