"""Softening by what a specimen went through: Mullins, set, conditioning, thixotropy."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import fading, largest, resolved_times
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class StressSoftening(AbstractEffect):
    """Softening of the pad below its largest depth: F = F_below (1 - s (1 - d/dmax)).

    dmax is the largest depth so far in the test.
    """

    s: Constant = constant(
        "fraction", "relative loss of force when the pad is nearly unloaded, zero or more"
    )
    name: ClassVar[str] = "stress_softening"
    level: ClassVar[Level] = Level.SCALING
    law: ClassVar[str] = "F -> F (1 - s (1 - delta/delta_max))"
    seen: ClassVar[str] = "too little force after moving back, right on the way in"
    reference: ClassVar[str] = "Ogden & Roxburgh 1999, doi:10.1098/rspa.1999.0431"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(0.1 * scales.force))

    def force(self, below: Law, motion: Motion) -> Array:
        deepest = largest(motion.displacement, motion.ago)
        return below.force(motion) * self._remaining(motion.displacement, deepest)

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, deepest = state
        inner, force = below.step(inner, line)
        deepest = xp.maximum(deepest, line.displacement)
        return (inner, deepest), force * self._remaining(line.displacement, deepest)

    def _remaining(self, depth: Array, deepest: Array) -> Array:
        """Return the share of the force that is left."""
        pressed = deepest > 0.0
        slack = 1.0 - depth / xp.where(pressed, deepest, 1.0)
        return 1.0 - self.s * xp.where(pressed, slack, 0.0)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return None if protocol.unloads else "no test unloads"


class PermanentSet(AbstractEffect):
    """Permanent set of the pad's surface: depth = max(d - share dmax, 0).

    dmax is the largest d so far in the test, also while loading.
    """

    share: Constant = constant(
        "fraction", "share of the largest depth that does not come back, zero or more"
    )
    name: ClassVar[str] = "permanent_set"
    level: ClassVar[Level] = Level.DEPTH
    law: ClassVar[str] = "delta -> max(delta - share delta_max, 0)"
    seen: ClassVar[str] = "contact is lost early when the platen retracts"
    reference: ClassVar[str] = "Dorfmann & Ogden 2004, doi:10.1016/j.ijsolstr.2003.11.014"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(scales.stiffness * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        deepest = xp.maximum(largest(motion.displacement, motion.ago), 0.0)
        kept = self._speed_ratio(motion, deepest)
        slowed = replace(
            motion, velocity=motion.velocity * kept, acceleration=motion.acceleration * kept
        )
        return below.force(at_depth(slowed, motion.displacement - self.share * deepest))

    def begin(self, below: Law, displacement: Array) -> State:
        deepest = xp.maximum(displacement, 0.0)
        return below.begin(xp.maximum(displacement - self.share * deepest, 0.0)), deepest

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, deepest = state
        deepest = xp.maximum(deepest, line.displacement)
        slowed = replace(line, velocity=line.velocity * self._speed_ratio(line, deepest))
        lowered = line_at_depth(slowed, line.displacement - self.share * deepest)
        inner, force = below.step(inner, lowered)
        return (inner, deepest), force

    def _speed_ratio(self, moved: Motion | Line, deepest: Array) -> Array:
        """Return the specimen's speed over the platen's."""
        growing = (moved.displacement >= deepest) & (moved.velocity > 0.0)
        return xp.where(growing, 1.0 - self.share, 1.0)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return None if protocol.unloads else "no test unloads"


_TESTS = (0.3, 5.0)
"""Bounds of the number of tests over which it is conditioned: the first one or a few.

Where it takes more tests than a study has, each weakens it alike, which is fluid_leak: of tests at
even intervals all but 4 % of the force is the leak's at 20 tests. The leak has a constant less.
"""


class Conditioning(AbstractEffect):
    """Weakening with each test: F = F_below (1 - share (1 - e^{-n/tests})), n tests before.

    Within a test nothing is lost, however long it takes.
    """

    share: Constant = constant(
        "fraction", "share of the force that is lost in the end, zero or more"
    )
    tests: Constant = constant("count", "number of tests after which 63 % of that is lost, above 0")
    name: ClassVar[str] = "conditioning"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 4
    not_stepped: ClassVar[str] = "it changes from test to test, and steps are of one test"
    law: ClassVar[str] = "F -> F (1 - share (1 - e^(-n/tests))), n tests before"
    seen: ClassVar[str] = "the first test strongest, each later one weaker, then all alike"
    reference: ClassVar[str] = "Fung 1993, Biomechanics, ch. 7.5, preconditioning"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(scales.force), LogUniform(*_TESTS))

    def force(self, below: Law, motion: Motion) -> Array:
        lost = -self.share * xp.expm1(-motion.tests_before / self.tests)
        return below.force(motion) * (1.0 - lost)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return None if protocol.tests > 1 else "there is only one test"


class Thixotropy(AbstractEffect):
    r"""Weakening by motion: F = F_below (1 - share y), dy/dt = (1 - y) speed/way - y/time.

    y = 0 at first. In :math:`\xi = t/time + s/way`, with s the distance travelled, y is one
    relaxing mode driven by s/way.
    """

    share: Constant = constant(
        "fraction",
        "share of the force that is lost where all structure is broken down, zero or more",
    )
    time: Constant = constant("time", "time constant of its recovery at rest")
    way: Constant = constant("displacement", "distance over which motion breaks it down")
    name: ClassVar[str] = "thixotropy"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 3
    law: ClassVar[str] = "F -> F (1 - share y), dy/dt = |v| (1 - y)/way - y/time"
    seen: ClassVar[str] = "weaker after motion, and a force that rises again in holds"
    reference: ClassVar[str] = "Moore 1959; Barnes 1997, doi:10.1016/S0377-0257(97)00004-9"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        low, high = resolved_times(scales)
        return cls(
            scales.positive(0.7 * scales.force),
            LogUniform(low, high),
            lognormal(0.5 * scales.depth, 3.0),
        )

    def force(self, below: Law, motion: Motion) -> Array:
        travel = xp.abs(xp.steps(motion.displacement))
        moved = xp.cumsum(travel) / self.way
        xi_step = (motion.time - motion.time[0]) / self.time + moved
        return below.force(motion) * (
            1.0 - self.share * hereditary_force(*fading(1.0, 1.0), xi_step, moved)
        )

    def begin(self, below: Law, displacement: Array) -> State:
        nothing = Relaxing(xp.zeros_like(displacement), np.zeros(1))
        return below.begin(displacement), displacement, nothing

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, depth, own = state
        inner, force = below.step(inner, line)
        moved = xp.abs(line.displacement - depth) / self.way
        xi_step = line.duration / self.time + moved
        own, broken = hereditary_step(*fading(1.0, 1.0), own, xi_step, own.depth + moved)
        return (inner, line.displacement, own), force * (1.0 - self.share * broken)
