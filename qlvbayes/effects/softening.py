"""Changes of the material: relaxation, softening by what it went through, leaks."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import (
    AbstractClocked,
    AbstractCurve,
    AbstractEffect,
    AbstractPointwise,
    Level,
    Protocol,
)
from qlvbayes.effects.history import (
    LEVELS,
    REACHED,
    duration,
    fading,
    largest,
    material_duration,
    material_time,
    resolved_rates,
    resolved_times,
)
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Spectrum
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.priors import HalfNormal, LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class ExtraRelaxationMode(AbstractEffect):
    """Further relaxation mode: G -> (1 - c) G + c e^{-v t}, so F = (1 - c) F_below + c F_mode."""

    c: Constant = constant("fraction", "the mode's share, zero or more")
    v: Constant = constant("rate", "its rate")
    name = "extra_relaxation_mode"
    level = Level.MATERIAL
    law = "G -> (1 - c) G + c e^(-v t)"
    seen = "holds decay at one more rate, quicker or slower than the others"
    reference = "Tschoegl 1989, doi:10.1007/978-3-642-73602-5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # at most a fifth of a sample's: a quicker mode is a drag that grows with the stiffness, as
        # a squeeze film's does (a cosine of 0.96 there)
        low, high = resolved_rates(scales)
        return cls(scales.positive(0.6 * scales.force), LogUniform(low, high))

    def force(self, below: Law, motion: Motion) -> Array:
        return self._with_mode(below).force(motion)

    def spectrum(self, fractions: Array, rates: Array) -> tuple[Array, Array]:
        share, rate = xp.asarray(self.c)[None], xp.asarray(self.v)[None]
        return (
            xp.concatenate([(1.0 - self.c) * fractions, share]),
            xp.concatenate([rates, rate]),
        )

    def begin(self, below: Law, displacement: Array) -> State:
        return self._with_mode(below).begin(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        return self._with_mode(below).step(state, line)

    def _with_mode(self, below: Law) -> Law:
        relaxation = Spectrum(*self.spectrum(*below.relaxation.spectrum()))
        return Law(below.elastic, relaxation, below.layers)


class StrainDependentRate(AbstractEffect):
    """Rates of relaxation that change with depth: v_i -> v_i e^{alpha d}.

    All modes then relax in the material time xi = int e^{alpha d} dt.
    """

    alpha: Constant = constant("exponent", "how depth speeds up relaxation, of either sign")
    name = "strain_dependent_rate"
    level = Level.MATERIAL
    rank = 1
    law = "v_i -> v_i e^(alpha delta)"
    seen = "holds at different depths decay at different rates"
    reference = "Schapery 1969, doi:10.1002/pen.760090410"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(0.2 * scales.force * scales.depth))

    def force(self, below: Law, motion: Motion) -> Array:
        xi = material_time(motion.time, motion.displacement, self.alpha)
        return below.force(replace(motion, time=xi))

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, depth = state
        xi_step = material_duration(line.duration, depth, line.displacement, self.alpha)
        inner, force = below.step(inner, replace(line, duration=xi_step))
        return (inner, line.displacement), force


class StrainDependentStrength(AbstractPointwise):
    """Relaxing share that changes with depth: F = (1 - s) F_below + s F_e(d), s = 1 - e^{-beta d}.

    F_e is the instantaneous elastic force.
    """

    beta: Constant = constant(
        "exponent", "how depth lessens the share that relaxes, of either sign"
    )
    name = "strain_dependent_strength"
    level = Level.MATERIAL
    rank = 2
    law = "F -> e^(-beta delta) F + (1 - e^(-beta delta)) F_e"
    seen = "holds at different depths lose different shares of their force"
    reference = "Provenzano et al. 2001, doi:10.1114/1.1408926"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(0.7 * scales.force * scales.depth))

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        share = -xp.expm1(-self.beta * now.displacement)
        return force + share * (below.elastic.force(now.displacement) - force)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return "all holds are at one depth" if protocol.one_depth else None


class StressSoftening(AbstractEffect):
    """Softening of the pad below its largest depth: F = F_below (1 - s (1 - d/dmax)).

    dmax is the largest depth so far in the test.
    """

    s: Constant = constant(
        "fraction", "relative loss of force when the pad is nearly unloaded, zero or more"
    )
    name = "stress_softening"
    level = Level.SCALING
    law = "F -> F (1 - s (1 - delta/delta_max))"
    seen = "too little force after moving back, right on the way in"
    reference = "Ogden & Roxburgh 1999, doi:10.1098/rspa.1999.0431"

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
    name = "permanent_set"
    level = Level.DEPTH
    law = "delta -> max(delta - share delta_max, 0)"
    seen = "contact is lost early when the platen retracts"
    reference = "Dorfmann & Ogden 2004, doi:10.1016/j.ijsolstr.2003.11.014"

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
    name = "conditioning"
    level = Level.SCALING
    rank = 4
    not_stepped = "it changes from test to test, and steps are of one test"
    law = "F -> F (1 - share (1 - e^(-n/tests))), n tests before"
    seen = "the first test strongest, each later one weaker, then all alike"
    reference = "Fung 1993, Biomechanics, ch. 7.5, preconditioning"

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
    name = "thixotropy"
    level = Level.SCALING
    rank = 3
    law = "F -> F (1 - share y), dy/dt = |v| (1 - y)/way - y/time"
    seen = "weaker after motion, and a force that rises again in holds"
    reference = "Moore 1959; Barnes 1997, doi:10.1016/S0377-0257(97)00004-9"

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


class FluidLeak(AbstractClocked):
    """Weakening by a leak: F = F_below e^{-rate t}, t since the pad's first test began."""

    rate: Constant = constant("rate", "share of the force lost per second, zero or more")
    name = "fluid_leak"
    level = Level.SCALING
    rank = 1
    law = "F -> F e^(-rate t)"
    seen = "each test weaker than the one before, all along it"
    reference = "Darcy 1856; Biot 1941, doi:10.1063/1.1712886"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(scales.force * duration(scales)))

    def at_clock(self, force: Array, clock: Array) -> Array:
        return force * xp.exp(-self.rate * clock)


class LevellingLeak(FluidLeak):
    """Leak that levels off: F = F_below w, dw/dt = -rate w + back (1 - w), w(0) = 1.

    t is the pad's clock. Solved, w = 1 - rate (1 - e^{-(rate + back) t})/(rate + back), which
    levels off at back/(rate + back).
    """

    back: Constant = constant("rate", "share of the loss that returns per second, zero or more")
    name = "levelling_leak"
    generalises = FluidLeak.name
    reduces: ClassVar[dict[str, float]] = {"back": 0.0}
    law = "F -> F w, dw/dt = -rate w + back (1 - w)"
    seen = "each test weaker than the one before, the later the less"
    reference = "Biot 1941, doi:10.1063/1.1712886"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # of tests at even intervals one that levels off within the study is conditioning to 0.998,
        # by the clock in place of the count: only a pause or one long test tells the two apart
        whole = duration(scales)
        return cls(scales.positive(REACHED * scales.force * whole), HalfNormal(LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        lost = self.rate * clock * exp_slope(-(self.rate + self.back) * clock)
        return force * (1.0 - lost)


class SlowChange(AbstractCurve, AbstractClocked):
    """Slow change of the scale: F = F_below (1 + size (P1 + quadratic P2 + cubic P3)).

    P1, P2 and P3 are Legendre polynomials over the clock.
    """

    name = "slow_change"
    level = Level.SCALING
    rank = 2
    law = "F -> F (1 + size (P1 + quadratic P2 + cubic P3)(t))"
    seen = "tests weaker or stronger as the clock runs, not all one way"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls.scaled(scales, scales.force)

    def at_clock(self, force: Array, clock: Array) -> Array:
        return force * (1.0 + self.curve(clock))
