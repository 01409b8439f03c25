"""The force is recorded late."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.effect import AbstractEffect, Level
from qlvbayes.law import Law
from qlvbayes.motion import Motion
from qlvbayes.scales import Scales


class ChannelLag(AbstractEffect):
    """F(t) = F_below(t - delay), and before the start the force of the start.

    delay: of the force's channel behind the displacement's (s), zero or more. The force beneath is
    taken at the delayed times themselves, which join the grid; there the motion is on the straight
    line between its points.
    """

    delay: Any
    name: ClassVar[str] = "channel_lag"
    level: ClassVar[Level] = Level.CHANNEL
    units: ClassVar[dict[str, str]] = {"delay": "time"}
    null: ClassVar[dict[str, float]] = {"delay": 0.0}
    costly: ClassVar[bool] = True
    law: ClassVar[str] = "F(t) -> F(t - delay)"
    seen: ClassVar[str] = "force late against displacement, in proportion to speed"
    reference: ClassVar[str] = "Oppenheim & Schafer 2010, Discrete-Time Signal Processing, ch. 5"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Delay scaled by the top speed and the secant stiffness."""
        speed = scales.speed if scales.speed > 0.0 else 1.0
        return cls(scales.positive(scales.force / scales.depth * speed))

    def force(self, below: Law, motion: Motion) -> Array:
        """Force beneath at the delayed times."""
        joined, order = joined_with(motion, motion.time - self.delay)
        return below.force(joined)[jnp.argsort(order)][: motion.time.shape[0]]


def joined_with(motion: Motion, late: Array) -> tuple[Motion, Array]:
    """The motion with delayed times (M,), those before the start at it; and its order.

    argsort(order) gives the places of the delayed times, then those of the motion's own.
    """
    first = motion.alone.time[0]
    late = jnp.where(late > first, late, first)
    joined = jax.tree.map(
        lambda new, old: jnp.concatenate([new, old]) if old.ndim else old,
        _at(motion, late),
        motion,
    )
    # of equal times the delayed one comes first, as it does for any delay above 0
    order = jnp.argsort(jax.lax.stop_gradient(joined.time))
    return jax.tree.map(lambda x: x[order] if x.ndim else x, joined), order


def _at(motion: Motion, time: Array) -> Motion:
    """The motion at other times, all from time[0] to time[-1]: straight lines, as the grid's are.

    Velocity and acceleration are those just after a point, as on the grid.
    """
    after = jnp.clip(jnp.searchsorted(motion.time, time), 1, motion.time.shape[0] - 1)
    step = motion.time[after] - motion.time[after - 1]
    travel = motion.displacement[after] - motion.displacement[after - 1]
    slope = travel / jnp.where(step > 0.0, step, 1.0)
    here = jnp.where(time < motion.time[after], after - 1, after)
    elapsed = time - motion.time[here]
    return Motion(
        time,
        motion.displacement[after] + slope * (time - motion.time[after]),
        motion.velocity[here] + motion.acceleration[here] * elapsed,
        motion.acceleration[here],
        motion.start,
        None if motion.ago is None else jnp.zeros_like(motion.ago),
    )
