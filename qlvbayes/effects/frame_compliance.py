"""Define frame compliance: the rig deflects in proportion to force."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_STEPS = 4  # quasi-Newton steps; their slope is right to a few per cent


class AbstractFrame(AbstractEffect):
    """Deflection of the frame under the force: the pad is pressed less deep than the platen moves.

    The force is solved at all points at once by quasi-Newton steps with the instantaneous elastic
    stiffness: four steps give 1e-5 of the peak for a frame ten times as stiff as the pad. The
    frame's own speed is neglected against the platen's.
    """

    level: ClassVar[Level] = Level.FRAME
    costly: ClassVar[bool] = True

    @abstractmethod
    def deflection(self, force: Array) -> tuple[Array, Array]:
        """Return the frame's deflection (mm) at a force (N), and its slope (mm/N)."""

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the solution of F = below(displacement - deflection)."""
        force = xp.zeros_like(motion.time)
        for _ in range(_STEPS):  # no scan: the law beneath is compiled by itself
            depth, slope = self._pad_depth(below, motion.displacement, force)
            answer = below.force(replace(motion, displacement=depth))
            force = (answer + slope * force) / (1.0 + slope)
        return force

    def begin(self, below: Law, displacement: Array) -> State:
        """Return a state of the law beneath for each Newton step, as each has its own motion."""
        zero = xp.zeros_like(displacement)
        force, states = zero, []
        for _ in range(_STEPS):
            depth, slope = self._pad_depth(below, displacement, force)
            states.append(below.begin(depth))
            _, answer = below.step(states[-1], Line(zero, depth, zero))
            force = (answer + slope * force) / (1.0 + slope)
        return tuple(states)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the states and the solution of F = below(displacement - deflection)."""
        force, moved = xp.zeros_like(line.displacement), []
        for one in state:
            depth, slope = self._pad_depth(below, line.displacement, force)
            one, answer = below.step(one, replace(line, displacement=depth))
            moved.append(one)
            force = (answer + slope * force) / (1.0 + slope)
        return tuple(moved), force

    def _pad_depth(self, below: Law, displacement: Array, force: Array) -> tuple[Array, Array]:
        """Return the depth (mm) of the pad when the frame deflects under a force, and a slope.

        The slope is the frame's compliance times the pad's stiffness.
        """
        deflected, compliance = self.deflection(force)
        depth = displacement - deflected
        return depth, compliance * below.elastic.stiffness(depth)


class FrameCompliance(AbstractFrame):
    """Frame that deflects in proportion to the force: depth = displacement - compliance F.

    * ``compliance``: one over the frame's stiffness (mm/N), zero or more.
    """

    compliance: Constant
    name: ClassVar[str] = "frame_compliance"
    units: ClassVar[dict[str, str]] = {"compliance": "compliance"}
    null: ClassVar[dict[str, float]] = {"compliance": 0.0}
    law: ClassVar[str] = "delta -> delta - compliance F"
    seen: ClassVar[str] = "softer in proportion to force"
    reference: ClassVar[str] = "Oliver & Pharr 1992, doi:10.1557/JMR.1992.1564"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a compliance scaled by peak force and secant stiffness."""
        # its sd is 2.5 % of the pad's own compliance: a frame as soft as a pad lies at 40 sd
        return cls(scales.positive(2.0 * scales.force**2 / scales.depth))

    def deflection(self, force: Array) -> tuple[Array, Array]:
        """Return compliance F, and the compliance."""
        return self.compliance * force, self.compliance
