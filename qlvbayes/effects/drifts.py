"""Changes of the force with the clock or from test to test: offset, drift, leak, creep."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, AbstractPointwise, Level
from qlvbayes.effects.history import duration, fading, resolved_times
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.priors import HalfNormal, LogUniform, Normal
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array


class ForceOffset(AbstractPointwise):
    """Offset of all forces: F = F_below + offset."""

    offset: Constant = constant("force", "reading of the unloaded cell, of either sign")
    name: ClassVar[str] = "force_offset"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 1
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += offset"
    seen: ClassVar[str] = "all forces shifted alike, those without contact too"
    reference: ClassVar[str] = "ISO 376:2011, zero of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(1.0))

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        return force + self.offset


class AbstractClocked(AbstractEffect):
    """Effect that depends on the time (s) since the pad's first test began."""

    @abstractmethod
    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return what a force (N) becomes at a time (s) of the pad's clock."""

    def force(self, below: Law, motion: Motion) -> Array:
        return self.at_clock(below.force(motion), motion.clock)

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), xp.zeros_like(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, clock = state
        inner, force = below.step(inner, line)
        clock = clock + line.duration
        return (inner, clock), self.at_clock(force, clock)


class ForceDrift(AbstractClocked):
    """Drift of the load cell: F = F_below + rate t, t since the pad's first test began."""

    rate: Constant = constant("force_rate", "drift of the cell's zero, of either sign")
    name: ClassVar[str] = "force_drift"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 2
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += rate t"
    seen: ClassVar[str] = "a shift of all forces that grows from test to test"
    reference: ClassVar[str] = "ISO 376:2011, creep and drift of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(duration(scales)))

    def at_clock(self, force: Array, clock: Array) -> Array:
        return force + self.rate * clock


_LEVELS = 4.0  # prior sd of the slowing over one over the study's duration: it may level off within
_REACHED = 0.3  # share of rate x duration that the drift reaches at the slowing's median


class LevellingDrift(ForceDrift):
    """Drift of the load cell that levels off: F = F_below + rate (1 - e^{-slowing t})/slowing.

    t is the pad's clock.
    """

    slowing: Constant = constant("rate", "rate at which the drift dies out, zero or more")
    name: ClassVar[str] = "levelling_drift"
    generalises: ClassVar[str] = ForceDrift.name
    reduces: ClassVar[dict[str, float]] = {"slowing": 0.0}
    law: ClassVar[str] = "F += rate (1 - e^(-slowing t))/slowing"
    seen: ClassVar[str] = "a shift of all forces that grows from test to test, the later the less"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        whole = duration(scales)
        return cls(scales.signed(_REACHED * whole), HalfNormal(_LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        return force + self.rate * clock * exp_slope(-self.slowing * clock)


class FluidLeak(AbstractClocked):
    """Weakening by a leak: F = F_below e^{-rate t}, t since the pad's first test began."""

    rate: Constant = constant("rate", "share of the force lost per second, zero or more")
    name: ClassVar[str] = "fluid_leak"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 1
    law: ClassVar[str] = "F -> F e^(-rate t)"
    seen: ClassVar[str] = "each test weaker than the one before, all along it"
    reference: ClassVar[str] = "Darcy 1856; Biot 1941, doi:10.1063/1.1712886"

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
    name: ClassVar[str] = "levelling_leak"
    generalises: ClassVar[str] = FluidLeak.name
    reduces: ClassVar[dict[str, float]] = {"back": 0.0}
    law: ClassVar[str] = "F -> F w, dw/dt = -rate w + back (1 - w)"
    seen: ClassVar[str] = "each test weaker than the one before, the later the less"
    reference: ClassVar[str] = "Biot 1941, doi:10.1063/1.1712886"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # of tests at even intervals one that levels off within the study is conditioning to 0.998,
        # by the clock in place of the count: only a pause or one long test tells the two apart
        whole = duration(scales)
        return cls(scales.positive(_REACHED * scales.force * whole), HalfNormal(_LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        lost = self.rate * clock * exp_slope(-(self.rate + self.back) * clock)
        return force * (1.0 - lost)


_LARGEST = 2.0  # largest P1 + quadratic P2 + cubic P3, within 50 %, for both at their priors' sd


class OffsetsByTest(AbstractEffect):
    """Offset of each test's force: F = F_below + size (P1 + quadratic P2 + cubic P3).

    The Legendre polynomials are taken at the clock of the test's beginning. With force_offset this
    gives any four tests offsets of their own, and more tests offsets on a smooth curve.
    """

    size: Constant = constant("force", "size of the straight part, of either sign")
    quadratic: Constant = constant("count", "size of the part P2 over that of the straight one")
    cubic: Constant = constant("count", "size of the part P3 over that of the straight one")
    duration: Constant = constant("time", "duration of the study, which is fixed")
    name: ClassVar[str] = "offsets_by_test"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 3
    off_pad: ClassVar[bool] = True
    outside: ClassVar[bool] = True
    not_stepped: ClassVar[str] = (
        "its offset is that of one test of the study, and a step is of none"
    )
    law: ClassVar[str] = "F += size (P1 + quadratic P2 + cubic P3)(start)"
    seen: ClassVar[str] = "all forces of a test shifted alike, each test by its own amount"
    reference: ClassVar[str] = "Abramowitz & Stegun 1964, ch. 22"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        curved = Normal(0.0, 1.0), Normal(0.0, 1.0)
        return cls(scales.signed(_LARGEST), *curved, duration(scales))

    def force(self, below: Law, motion: Motion) -> Array:
        return below.force(motion) + self.size * _along(self, motion.start)


class SlowChange(AbstractClocked):
    """Slow change of the scale: F = F_below (1 + size (P1 + quadratic P2 + cubic P3)).

    P1, P2 and P3 are Legendre polynomials over the clock.
    """

    size: Constant = constant("fraction", "size of the straight part, of either sign")
    quadratic: Constant = constant("count", "size of the part P2 over that of the straight one")
    cubic: Constant = constant("count", "size of the part P3 over that of the straight one")
    duration: Constant = constant("time", "duration of the study, which is fixed")
    name: ClassVar[str] = "slow_change"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 2
    outside: ClassVar[bool] = True
    law: ClassVar[str] = "F -> F (1 + size (P1 + quadratic P2 + cubic P3)(t))"
    seen: ClassVar[str] = "tests weaker or stronger as the clock runs, not all one way"
    reference: ClassVar[str] = "Abramowitz & Stegun 1964, ch. 22"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        curved = Normal(0.0, 1.0), Normal(0.0, 1.0)
        return cls(scales.signed(_LARGEST * scales.force), *curved, duration(scales))

    def at_clock(self, force: Array, clock: Array) -> Array:
        return force * (1.0 + self.size * _along(self, clock))


def _along(effect: OffsetsByTest | SlowChange, clock: Array) -> Array:
    """Return P1 + quadratic P2 + cubic P3, of Legendre, over a clock from 0 to the duration."""
    x = xp.clip(2.0 * clock / effect.duration - 1.0, -1.0, 1.0)
    second, third = 0.5 * (3.0 * x**2 - 1.0), 0.5 * (5.0 * x**2 - 3.0) * x
    return x + effect.quadratic * second + effect.cubic * third


class LoadCellCreep(AbstractEffect):
    """Creep of the load cell: F = F_below + share y, with dy/dt = (F_below - y)/time.

    The cell is at rest under the first force of a record, :math:`y(0) = F_{below}(0)`.
    """

    share: Constant = constant(
        "fraction", "share of a load that the cell adds in the end, zero or more"
    )
    time: Constant = constant("time", "time constant of the creep")
    name: ClassVar[str] = "load_cell_creep"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 4
    law: ClassVar[str] = "F += share y, dy/dt = (F - y)/time"
    seen: ClassVar[str] = "force creeps up under load, and stays for a while when it is gone"
    reference: ClassVar[str] = "ISO 376:2011, creep of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        low, high = resolved_times(scales)
        ramp = scales.depth / scales.speed if scales.speed > 0.0 else low
        times = LogUniform(min(max(low, ramp), 0.5 * high), high)  # slower than the fastest ramp
        return cls(scales.positive(0.7 * scales.force), times)

    def force(self, below: Law, motion: Motion) -> Array:
        load = below.force(motion)
        lacking = hereditary_force(*self._lacking, motion.time, load - load[0])
        return load + self.share * (load - lacking)

    def begin(self, below: Law, displacement: Array) -> State:
        inner = below.begin(displacement)
        still = xp.zeros_like(displacement)
        load = below.step(inner, Line(still, displacement, still))[1]
        return inner, Relaxing(load, np.zeros(1))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, own = state
        inner, load = below.step(inner, line)
        own, lacking = hereditary_step(*self._lacking, own, line.duration, load)
        return (inner, own), load + self.share * (load - lacking)

    @property
    def _lacking(self) -> tuple[Linear, Prony]:
        """Return the laws whose hereditary integral of F is F - y: linear, with one mode."""
        return fading(1.0, 1.0 / self.time)
