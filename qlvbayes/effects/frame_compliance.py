"""The rig gives way in proportion to force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
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
        return balanced(below, motion, lambda force: (self.compliance * force, self.compliance))


def balanced(below: Law, motion: Motion, yielding: Callable[[Array], tuple[Array, Array]]) -> Array:
    """Force (N,) of a pad in a frame; ``yielding`` gives its deflection and compliance at a force.

    Newton's steps take the instantaneous elastic stiffness for the pad's own.
    """
    force = jnp.zeros_like(motion.time)
    for _ in range(_STEPS):  # no scan: the law beneath runs in pieces of its own
        deflection, compliance = yielding(force)
        depth = motion.displacement - deflection
        slope = compliance * below.elastic.stiffness(depth)
        answer = below.force(replace(motion, displacement=depth))
        force = (answer + slope * force) / (1.0 + slope)
    return force
