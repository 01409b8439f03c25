"""Errors of the load cell and its channel: offset, drift, creep, lag."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import (
    AbstractClocked,
    AbstractCurve,
    AbstractEffect,
    AbstractPointwise,
    Level,
)
from qlvbayes.effects.history import (
    LEVELS,
    REACHED,
    duration,
    fading,
    resolved_times,
)
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import Relaxing, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.laws.smoothmath import exp_slope
from qlvbayes.priors import HalfNormal, LogUniform, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import Pytree, constant
from qlvbayes.xp import Array


class ForceOffset(AbstractPointwise):
    """Offset of all forces: F = F_below + offset."""

    offset: Constant = constant("force", "reading of the unloaded cell, of either sign")
    name = "force_offset"
    level = Level.SENSOR
    rank = 1
    off_pad = True
    law = "F += offset"
    seen = "all forces shifted alike, those without contact too"
    reference = "ISO 376:2011, zero of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(1.0))

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        return force + self.offset


class ForceDrift(AbstractClocked):
    """Drift of the load cell: F = F_below + rate t, t since the pad's first test began."""

    rate: Constant = constant("force_rate", "drift of the cell's zero, of either sign")
    name = "force_drift"
    level = Level.SENSOR
    rank = 2
    off_pad = True
    law = "F += rate t"
    seen = "a shift of all forces that grows from test to test"
    reference = "ISO 376:2011, creep and drift of a force transducer"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(duration(scales)))

    def at_clock(self, force: Array, clock: Array) -> Array:
        return force + self.rate * clock


class LevellingDrift(ForceDrift):
    """Drift of the load cell that levels off: F = F_below + rate (1 - e^{-slowing t})/slowing.

    t is the pad's clock.
    """

    slowing: Constant = constant("rate", "rate at which the drift dies out, zero or more")
    name = "levelling_drift"
    generalises = ForceDrift.name
    reduces: ClassVar[dict[str, float]] = {"slowing": 0.0}
    law = "F += rate (1 - e^(-slowing t))/slowing"
    seen = "a shift of all forces that grows from test to test, the later the less"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        whole = duration(scales)
        return cls(scales.signed(REACHED * whole), HalfNormal(LEVELS / whole))

    def at_clock(self, force: Array, clock: Array) -> Array:
        return force + self.rate * clock * exp_slope(-self.slowing * clock)


class OffsetsByTest(AbstractCurve):
    """Offset of each test's force: F = F_below + size (P1 + quadratic P2 + cubic P3).

    The Legendre polynomials are taken at the clock of the test's beginning. With force_offset this
    gives any four tests offsets of their own, and more tests offsets on a smooth curve.
    """

    size: Constant = constant("force", "size of the straight part, of either sign")
    name = "offsets_by_test"
    level = Level.SENSOR
    rank = 3
    off_pad = True
    not_stepped = "its offset is that of one test of the study, and a step is of none"
    law = "F += size (P1 + quadratic P2 + cubic P3)(start)"
    seen = "all forces of a test shifted alike, each test by its own amount"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls.scaled(scales, 1.0)

    def force(self, below: Law, motion: Motion) -> Array:
        return below.force(motion) + self.curve(motion.start)


class LoadCellCreep(AbstractEffect):
    """Creep of the load cell: F = F_below + share y, with dy/dt = (F_below - y)/time.

    The cell is at rest under the first force of a record, :math:`y(0) = F_{below}(0)`.
    """

    share: Constant = constant(
        "fraction", "share of a load that the cell adds in the end, zero or more"
    )
    time: Constant = constant("time", "time constant of the creep")
    name = "load_cell_creep"
    level = Level.SENSOR
    rank = 4
    law = "F += share y, dy/dt = (F - y)/time"
    seen = "force creeps up under load, and stays for a while when it is gone"
    reference = "ISO 376:2011, creep of a force transducer"

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


_ALONG = ("time", "displacement", "velocity", "acceleration", "ago", "sagitta")

LINES = 256  # most steps that the delay may span


class _Late(Pytree):
    """State of a force channel that lags behind the displacement.

    ``below`` is the state of the law beneath at the delayed time, ``displacement`` (mm) the
    displacement there, and ``force`` (N) the reading. ``count`` lines have followed since; their
    durations (s), ends (mm) and velocities (mm/s) have shape (LINES + 1,), the first line only as
    far as it is still to come.
    """

    below: State
    displacement: Array
    force: Array
    count: Array
    duration: Array
    end: Array
    velocity: Array


class ChannelLag(AbstractEffect):
    """Delay of the force: F(t) = F_below(t - delay), and the first force before the start.

    The force beneath is taken at the delayed times themselves, which join the grid; there the
    motion lies on the straight line between its points.
    """

    delay: Constant = constant(
        "time", "delay of the force's channel behind the displacement's, zero or more"
    )
    name = "channel_lag"
    level = Level.CHANNEL
    costly = True
    inverts = False
    not_inverted = "what is read is the force of an earlier moment"
    law = "F(t) -> F(t - delay)"
    seen = "force late against displacement, in proportion to speed"
    reference = "Oppenheim & Schafer 2010, Discrete-Time Signal Processing, ch. 5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # positive: a force that comes early is a squeeze film's, with a cosine of 0.99 for a pad
        # that stiffens, and no channel of the force foresees the displacement
        return cls(scales.positive(scales.force / scales.depth * scales.top_speed))

    def force(self, below: Law, motion: Motion) -> Array:
        joined, order = joined_with(motion, motion.time - self.delay)
        return xp.take(below.force(joined), xp.argsort(order)[: motion.time.shape[0]])

    def begin(self, below: Law, displacement: Array) -> State:
        still = xp.zeros_like(displacement)
        state, force = below.step(below.begin(displacement), Line(still, displacement, still))
        none = jnp.zeros(LINES + 1)
        return _Late(state, displacement, force, jnp.zeros((), int), none, none, none)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        late: _Late = state
        lost = late.count > LINES
        columns = (late.duration, late.end, late.velocity)
        added = (line.duration, line.displacement, line.velocity)
        pairs = zip(columns, added, strict=True)
        longer = [old.at[late.count].set(new) for old, new in pairs]
        late = _Late(late.below, late.displacement, late.force, late.count + 1, *longer)
        ahead = xp.sum(late.duration) - self.delay
        late, _ = jax.lax.while_loop(
            lambda carry: (carry[0].count > 0) & (carry[1] > 0.0),
            lambda carry: _advanced(below, *carry),
            (late, ahead),
        )
        return late, xp.where(lost, np.nan, late.force)


def _advanced(below: Law, late: _Late, ahead: Array) -> tuple[_Late, Array]:
    """Return the channel after the law beneath went along its first line, and the time left (s)."""
    first, end, velocity = late.duration[0], late.end[0], late.velocity[0]
    whole = ahead >= first
    taken = xp.where(whole, first, ahead)
    share = xp.where(whole, 1.0, taken / xp.where(first > 0.0, first, 1.0))
    displacement = xp.where(whole, end, late.displacement + share * (end - late.displacement))
    state, force = below.step(late.below, Line(taken, displacement, velocity))
    left = late.duration.at[0].add(-taken)
    columns = [
        xp.where(whole, jnp.roll(x.at[0].set(0.0), -1), x) for x in (left, late.end, late.velocity)
    ]
    count = late.count - xp.where(whole, 1, 0)
    return _Late(state, displacement, force, count, *columns), ahead - taken


def joined_with(motion: Motion, late: Array) -> tuple[Motion, Array]:
    """Return the motion with delayed times (M,) added to its grid, and the new grid's order."""
    first = motion.alone.time[0]
    late = xp.where(late > first, late, first)
    added = _at(motion, late)
    # of equal times the delayed one comes first, as it does for any delay above 0
    order = xp.argsort(xp.fixed(xp.concatenate([added.time, motion.time])))
    pairs = {name: (getattr(added, name), getattr(motion, name)) for name in _ALONG}
    along = {
        name: None if new is None else xp.take(xp.concatenate([new, old]), order)
        for name, (new, old) in pairs.items()
    }
    joined = replace(motion, **along)
    if joined.sagitta is None:
        return joined, order
    # the midpoint of a part of a step deviates less, by the square of the part's share
    step = xp.steps(motion.time)
    whole = xp.take(xp.concatenate([xp.take(step, _after(motion, late)), step]), order)
    share = xp.steps(joined.time) / xp.where(whole > 0.0, whole, 1.0)
    return replace(joined, sagitta=joined.sagitta * share**2), order


def _after(motion: Motion, time: Array) -> Array:
    """Return the indices of the points at which the steps end in which the times lie."""
    return xp.clip(xp.searchsorted(motion.time, time), 1, motion.time.shape[0] - 1)


def _at(motion: Motion, time: Array) -> Motion:
    """Return the motion at other times, from time[0] to time[-1], on its lines or parabolas."""
    after = _after(motion, time)
    end, place = xp.take(motion.time, after), xp.take(motion.displacement, after)
    step = end - xp.take(motion.time, after - 1)
    step = xp.where(step > 0.0, step, 1.0)
    slope = (place - xp.take(motion.displacement, after - 1)) / step
    here = xp.where(time < end, after - 1, after)
    elapsed = time - xp.take(motion.time, here)
    displacement = place + slope * (time - end)
    if motion.sagitta is not None:
        share = (end - time) / step
        displacement = displacement + 4.0 * xp.take(motion.sagitta, after) * share * (1.0 - share)
    return replace(
        motion,
        time=time,
        displacement=displacement,
        velocity=xp.take(motion.velocity, here) + xp.take(motion.acceleration, here) * elapsed,
        acceleration=xp.take(motion.acceleration, here),
        ago=None if motion.ago is None else xp.zeros_like(after),
        sagitta=None if motion.sagitta is None else xp.take(motion.sagitta, after),
    )


_INSTANT = 1e-30  # s, time of a filter that changes nothing and yet has a finite slope


class SpreadingLag(ChannelLag):
    """Delayed, filtered force: spread delay F' = y - F, y(t) = F_below(t - (1 - spread) delay).

    F = y at first. Before the start the force is that of the start; between the points at which the
    force beneath is taken it lies on straight lines.
    """

    spread: Constant = constant(
        "fraction", "share of it that is a first-order filter's, from 0 (a pure delay) to 1"
    )
    name = "spreading_lag"
    not_stepped = "its filter runs over points that the whole record lays down"
    generalises = ChannelLag.name
    reduces: ClassVar[dict[str, float]] = {"spread": 0.0}
    law = "F(t) -> F(t - (1 - spread) delay), filtered over spread delay"
    seen = "force late against displacement, and its kinks rounded"
    begin, step = AbstractEffect.begin, AbstractEffect.step

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(ChannelLag.default(scales).delay, Uniform(0.0, 1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        delayed = motion.time - (1.0 - self.spread) * self.delay
        # two more points for each resolve the curvature of the force in between
        before = delayed - self.spread * self.delay
        between = 0.5 * (motion.time[1:] + motion.time[:-1])
        joined, order = joined_with(motion, xp.concatenate([delayed, before, between]))
        force = below.force(joined)
        own = joined.time >= motion.alone.time[0]
        begin = xp.take(force, xp.first_true(own))
        change = xp.where(own, force - begin, 0.0)
        rate = 1.0 / (self.spread * self.delay + _INSTANT)
        filtering = Prony(np.array([1.0, -1.0]), xp.asarray(rate)[None])
        filtered = begin + hereditary_force(Linear(1.0), filtering, joined.time, change)
        return xp.take(filtered, xp.argsort(order)[: motion.time.shape[0]])
