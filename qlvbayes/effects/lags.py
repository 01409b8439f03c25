"""The force's channel lags behind that of the displacement."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import hereditary_force
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import Pytree, constant
from qlvbayes.xp import Array

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
    name: ClassVar[str] = "channel_lag"
    level: ClassVar[Level] = Level.CHANNEL
    costly: ClassVar[bool] = True
    inverts: ClassVar[bool] = False
    not_inverted: ClassVar[str] = "what is read is the force of an earlier moment"
    law: ClassVar[str] = "F(t) -> F(t - delay)"
    seen: ClassVar[str] = "force late against displacement, in proportion to speed"
    reference: ClassVar[str] = "Oppenheim & Schafer 2010, Discrete-Time Signal Processing, ch. 5"

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
        added = [
            old.at[late.count].set(new)
            for old, new in zip(
                (late.duration, late.end, late.velocity),
                (line.duration, line.displacement, line.velocity),
                strict=True,
            )
        ]
        late = _Late(late.below, late.displacement, late.force, late.count + 1, *added)
        ahead = xp.sum(late.duration) - self.delay

        def due(carry: tuple[_Late, Array]) -> Array:
            return (carry[0].count > 0) & (carry[1] > 0.0)

        def on(carry: tuple[_Late, Array]) -> tuple[_Late, Array]:
            return _advanced(below, *carry)

        late, _ = jax.lax.while_loop(due, on, (late, ahead))
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
    step = xp.take(motion.time, after) - xp.take(motion.time, after - 1)
    travel = xp.take(motion.displacement, after) - xp.take(motion.displacement, after - 1)
    slope = travel / xp.where(step > 0.0, step, 1.0)
    here = xp.where(time < xp.take(motion.time, after), after - 1, after)
    elapsed = time - xp.take(motion.time, here)
    displacement = xp.take(motion.displacement, after) + slope * (
        time - xp.take(motion.time, after)
    )
    if motion.sagitta is not None:
        share = (xp.take(motion.time, after) - time) / xp.where(step > 0.0, step, 1.0)
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
    name: ClassVar[str] = "spreading_lag"
    not_stepped: ClassVar[str] = "its filter runs over points that the whole record lays down"
    generalises: ClassVar[str] = ChannelLag.name
    reduces: ClassVar[dict[str, float]] = {"spread": 0.0}
    law: ClassVar[str] = "F(t) -> F(t - (1 - spread) delay), filtered over spread delay"
    seen: ClassVar[str] = "force late against displacement, and its kinks rounded"
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
