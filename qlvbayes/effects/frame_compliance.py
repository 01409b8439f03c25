"""Define frame compliance: the rig deflects in proportion to force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant

_STEPS = 4  # quasi-Newton steps; their slope is right to a few per cent


class FrameCompliance(AbstractEffect):
    """Deflection of the frame: depth = displacement - compliance F, where F is the force itself.

    It is solved at all grid points at once by quasi-Newton steps with the instantaneous elastic
    stiffness: four steps give 1e-5 of the peak for a frame ten times as stiff as the pad. The
    frame's own speed is neglected against the platen's.

    * ``compliance``: one over the frame's stiffness (mm/N), zero or more.
    """

    compliance: Constant
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
        """Return the effect with a compliance scaled by peak force and secant stiffness."""
        return cls(scales.positive(2.0 * scales.force**2 / scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the solution of F = below(displacement - compliance F)."""
        return balanced(below, motion, self._deflection)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return a state of the law beneath for each of Newton's steps."""
        return balanced_begin(below, displacement, self._deflection)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the states and the solution of F = below(displacement - compliance F)."""
        return balanced_step(below, state, line, self._deflection)

    def _deflection(self, force: Array) -> tuple[Array, Array]:
        return self.compliance * force, self.compliance


Deflection = Callable[[Array], tuple[Array, Array]]
"""Deflection (mm) and compliance (mm/N) of a frame at a force (N)."""


def balanced(below: Law, motion: Motion, deflection: Deflection) -> Array:
    """Return the force (N,) in N of a pad in a frame.

    Newton's steps use the instantaneous elastic stiffness in place of the pad's own.
    """
    force = jnp.zeros_like(motion.time)
    for _ in range(_STEPS):  # no scan: the law beneath is compiled by itself
        depth, slope = _pad_depth(below, motion.displacement, force, deflection)
        answer = below.force(replace(motion, displacement=depth))
        force = (answer + slope * force) / (1.0 + slope)
    return force


def balanced_begin(below: Law, displacement: Array, deflection: Deflection) -> tuple[State, ...]:
    """Return a state of the law beneath for each of Newton's steps, as each has its own motion."""
    zero = jnp.zeros_like(displacement)
    force, states = zero, []
    for _ in range(_STEPS):
        depth, slope = _pad_depth(below, displacement, force, deflection)
        states.append(below.begin(depth))
        _, answer = below.step(states[-1], Line(zero, depth, zero))
        force = (answer + slope * force) / (1.0 + slope)
    return tuple(states)


def balanced_step(
    below: Law, states: State, line: Line, deflection: Deflection
) -> tuple[tuple[State, ...], Array]:
    """Return the states and the force (N) of a pad in a frame after a line, as `balanced` does."""
    force, moved = jnp.zeros_like(line.displacement), []
    for state in states:
        depth, slope = _pad_depth(below, line.displacement, force, deflection)
        state, answer = below.step(state, replace(line, displacement=depth))
        moved.append(state)
        force = (answer + slope * force) / (1.0 + slope)
    return tuple(moved), force


def _pad_depth(
    below: Law, displacement: Array, force: Array, deflection: Deflection
) -> tuple[Array, Array]:
    """Return the depth (mm) of the pad when the frame deflects under a force, and a slope.

    The slope is the frame's compliance times the pad's stiffness.
    """
    deflected, compliance = deflection(force)
    depth = displacement - deflected
    return depth, compliance * below.elastic.stiffness(depth)
