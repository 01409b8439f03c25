"""Changes of the force with the clock or from test to test: offset, drift, leak, creep."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.effects.history import LARGEST, after_ramps, curve, duration, fading
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.priors import HalfNormal, LogUniform, Normal
from qlvbayes.priors.distributions import Constant
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


class ForceOffset(AbstractEffect):
    """Offset of all forces: F = F_below + offset.

    * ``offset``: reading of the unloaded cell (N), of either sign.
    """

    offset: Constant
    name: ClassVar[str] = "force_offset"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"offset": "force"}
    null: ClassVar[dict[str, float]] = {"offset": 0.0}
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += offset"
    seen: ClassVar[str] = "all forces shifted alike, those without contact too"
    reference: ClassVar[str] = "ISO 376:2011, zero of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with an offset scaled by the peak force."""
        return cls(scales.signed(1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the shifted force."""
        return below.force(motion) + self.offset

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the shifted force."""
        state, force = below.step(state, line)
        return state, force + self.offset


class OffsetsByTest(AbstractEffect):
    """Offset of each test's force: F = F_below + size (P1 + quadratic P2 + cubic P3).

    The Legendre polynomials are taken at the clock of the test's beginning. With force_offset this
    gives any four tests offsets of their own, and more tests offsets on a smooth curve.

    * ``size``: size of the straight part (N), of either sign.
    * ``quadratic``, ``cubic``: sizes of the curved parts over that of the straight one.
    * ``duration``: duration of the study (s), which is fixed.
    """

    size: Constant
    quadratic: Constant
    cubic: Constant
    duration: Constant
    name: ClassVar[str] = "offsets_by_test"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 3
    units: ClassVar[dict[str, str]] = {
        "size": "force",
        "quadratic": "count",
        "cubic": "count",
        "duration": "time",
    }
    null: ClassVar[dict[str, float]] = {"size": 0.0}
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
        """Return the effect with a size scaled by the peak force."""
        curved = Normal(0.0, 1.0), Normal(0.0, 1.0)
        return cls(scales.signed(LARGEST), *curved, duration(scales))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force, shifted by the test's offset."""
        shift = curve(motion.start, self.quadratic, self.cubic, self.duration)
        return below.force(motion) + self.size * shift


class ForceDrift(AbstractClocked):
    """Drift of the load cell: F = F_below + rate t, t since the pad's first test began.

    * ``rate``: drift of the cell's zero (N/s), of either sign.
    """

    rate: Constant
    name: ClassVar[str] = "force_drift"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {"rate": "force_rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += rate t"
    seen: ClassVar[str] = "a shift of all forces that grows from test to test"
    reference: ClassVar[str] = "ISO 376:2011, creep and drift of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the study's duration."""
        return cls(scales.signed(duration(scales)))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, shifted with the clock."""
        return force + self.rate * clock


_LEVELS = 4.0  # prior sd of the slowing over one over the study's duration: it may level off within
_REACHED = 0.3  # share of rate x duration that the drift reaches at the slowing's median


class LevellingDrift(AbstractClocked):
    """Drift of the load cell that levels off: F = F_below + rate (1 - e^{-slowing t})/slowing.

    t is the pad's clock.

    * ``rate``: drift of the cell's zero at first (N/s), of either sign.
    * ``slowing``: rate at which the drift dies out (1/s), zero or more.
    """

    rate: Constant
    slowing: Constant
    name: ClassVar[str] = "levelling_drift"
    level: ClassVar[Level] = ForceDrift.level
    rank: ClassVar[int] = ForceDrift.rank
    units: ClassVar[dict[str, str]] = {"rate": "force_rate", "slowing": "rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    off_pad: ClassVar[bool] = True
    generalises: ClassVar[str] = ForceDrift.name
    reduces: ClassVar[dict[str, float]] = {"slowing": 0.0}
    law: ClassVar[str] = "F += rate (1 - e^(-slowing t))/slowing"
    seen: ClassVar[str] = "a shift of all forces that grows from test to test, the later the less"
    reference: ClassVar[str] = "ISO 376:2011, creep and drift of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the shift at the end of the study."""
        whole = duration(scales)
        return cls(scales.signed(_REACHED * whole), HalfNormal(_LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, shifted with the clock."""
        return force + self.rate * clock * exp_slope(-self.slowing * clock)


class FluidLeak(AbstractClocked):
    """Weakening by a leak: F = F_below e^{-rate t}, t since the pad's first test began.

    * ``rate``: share of the force lost per second (1/s), zero or more.
    """

    rate: Constant
    name: ClassVar[str] = "fluid_leak"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"rate": "rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    law: ClassVar[str] = "F -> F e^(-rate t)"
    seen: ClassVar[str] = "each test weaker than the one before, all along it"
    reference: ClassVar[str] = "Darcy 1856; Biot 1941, doi:10.1063/1.1712886"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the peak force and the study's duration."""
        return cls(scales.positive(scales.force * duration(scales)))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, weakened with the clock."""
        return force * xp.exp(-self.rate * clock)


class LevellingLeak(AbstractClocked):
    """Leak that levels off: F = F_below w, dw/dt = -rate w + back (1 - w), w(0) = 1.

    t is the pad's clock. Solved, w = 1 - rate (1 - e^{-(rate + back) t})/(rate + back), which
    levels off at back/(rate + back).

    * ``rate``: share of the force lost per second at first (1/s), zero or more.
    * ``back``: share of the loss that returns per second (1/s), zero or more.
    """

    rate: Constant
    back: Constant
    name: ClassVar[str] = "levelling_leak"
    level: ClassVar[Level] = FluidLeak.level
    rank: ClassVar[int] = FluidLeak.rank
    units: ClassVar[dict[str, str]] = {"rate": "rate", "back": "rate"}
    null: ClassVar[dict[str, float]] = {"rate": 0.0}
    generalises: ClassVar[str] = FluidLeak.name
    reduces: ClassVar[dict[str, float]] = {"back": 0.0}
    law: ClassVar[str] = "F -> F w, dw/dt = -rate w + back (1 - w)"
    seen: ClassVar[str] = "each test weaker than the one before, the later the less"
    reference: ClassVar[str] = "Biot 1941, doi:10.1063/1.1712886"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a rate scaled by the loss at the end of the study."""
        # of tests at even intervals one that levels off within the study is conditioning to 0.998,
        # by the clock in place of the count: only a pause or one long test tells the two apart
        whole = duration(scales)
        return cls(scales.positive(_REACHED * scales.force * whole), HalfNormal(_LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, weakened with the clock."""
        lost = self.rate * clock * exp_slope(-(self.rate + self.back) * clock)
        return force * (1.0 - lost)


class SlowChange(AbstractClocked):
    """Slow change of the scale: F = F_below (1 + size (P1 + quadratic P2 + cubic P3)).

    P1, P2 and P3 are Legendre polynomials over the clock.

    * ``size``: size of the straight part (1), of either sign.
    * ``quadratic``, ``cubic``: sizes of the curved parts over that of the straight one.
    * ``duration``: duration of the study (s), which is fixed.
    """

    size: Constant
    quadratic: Constant
    cubic: Constant
    duration: Constant
    name: ClassVar[str] = "slow_change"
    level: ClassVar[Level] = Level.SCALING
    rank: ClassVar[int] = 2
    units: ClassVar[dict[str, str]] = {
        "size": "fraction",
        "quadratic": "count",
        "cubic": "count",
        "duration": "time",
    }
    null: ClassVar[dict[str, float]] = {"size": 0.0}
    outside: ClassVar[bool] = True
    law: ClassVar[str] = "F -> F (1 + size (P1 + quadratic P2 + cubic P3)(t))"
    seen: ClassVar[str] = "tests weaker or stronger as the clock runs, not all one way"
    reference: ClassVar[str] = "Abramowitz & Stegun 1964, ch. 22"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a size scaled by the peak force."""
        curved = Normal(0.0, 1.0), Normal(0.0, 1.0)
        return cls(scales.signed(LARGEST * scales.force), *curved, duration(scales))

    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return the force, its scale changed with the clock."""
        along = curve(clock, self.quadratic, self.cubic, self.duration)
        return force * (1.0 + self.size * along)


class LoadCellCreep(AbstractEffect):
    """Creep of the load cell: F = F_below + share y, with dy/dt = (F_below - y)/time.

    The cell is at rest under the first force of a record, :math:`y(0) = F_{below}(0)`.

    * ``share``: share of a load that the cell adds in the end, zero or more.
    * ``time``: time constant of the creep (s).
    """

    share: Constant
    time: Constant
    name: ClassVar[str] = "load_cell_creep"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = 4
    units: ClassVar[dict[str, str]] = {"share": "fraction", "time": "time"}
    null: ClassVar[dict[str, float]] = {"share": 0.0}
    law: ClassVar[str] = "F += share y, dy/dt = (F - y)/time"
    seen: ClassVar[str] = "force creeps up under load, and stays for a while when it is gone"
    reference: ClassVar[str] = "ISO 376:2011, creep of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a share scaled by the peak force."""
        return cls(scales.positive(0.7 * scales.force), LogUniform(*after_ramps(scales)))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the cell's creep added."""
        load = below.force(motion)
        lacking = hereditary_force(*self._mode, motion.time, load - load[0])
        return load + self.share * (load - lacking)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and the load under which the cell is at rest."""
        inner = below.begin(displacement)
        still = xp.zeros_like(displacement)
        load = below.step(inner, Line(still, displacement, still))[1]
        return inner, Relaxing(load, np.zeros(1))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the cell's creep added."""
        inner, own = state
        inner, load = below.step(inner, line)
        own, lacking = hereditary_step(*self._mode, own, line.duration, load)
        return (inner, own), load + self.share * (load - lacking)

    @property
    def _mode(self) -> tuple[Linear, Prony]:
        """Return the laws whose hereditary integral of F is F - y: linear, with one mode."""
        return fading(1.0, 1.0 / self.time)
