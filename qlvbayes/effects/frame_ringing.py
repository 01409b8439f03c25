"""Define ringing: a mass on the frame's spring swings after each abrupt change of speed."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.io.catalogue import READINGS_A_PERIOD, SLOWEST_HZ
from qlvbayes.laws.layered import Law
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_FASTEST = 200.0  # Hz: a stiff testing machine
_DAMPING = (0.005, 0.4)
"""Damping of bare steel, and that at which a swing of the other sign still has 28 % of the first.

Where it is damped critically, the mass follows the platen, which is inertia: with a machine that
speeds up within 55 ms the two forces have a cosine of 0.6 at 10 Hz and damping 1, of 0.99 at 23.
"""


class FrameRinging(AbstractEffect):
    """Force of a mass that the platen shakes: F = F_below + strength w / (2 pi f).

    w'' + 2 g w' + (g^2 + (2 pi f)^2) (w - a) = 0, g = 2 pi f damping, from rest, where a is the
    platen's acceleration and f its ``frequency``. After an abrupt change of speed by dv this is
    strength dv (1 + damping^2) e^{-g t} sin(2 pi f t). The oscillator is advanced from point to
    point exactly, for a velocity that is linear in between and jumps where the motion's does. The
    mass is strength / (2 pi f); beyond all frequencies this is inertia.

    * ``strength``: force that rings for each unit by which the speed changes (N s/mm), zero or
      more.
    * ``frequency``: frequency of the ringing (Hz).
    * ``damping``: its decay in the time of a radian, 0.1 a loss of 47 % in a period.
    """

    strength: Constant
    frequency: Constant
    damping: Constant
    name: ClassVar[str] = "frame_ringing"
    level: ClassVar[Level] = Level.SENSOR
    rank: ClassVar[int] = -1  # within what the load cell's own errors act on
    units: ClassVar[dict[str, str]] = {
        "strength": "drag",
        "frequency": "rate",
        "damping": "fraction",
    }
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    off_pad: ClassVar[bool] = True
    needs: ClassVar[str] = "velocity"
    shapes: ClassVar[int] = 24
    not_stepped: ClassVar[str] = (
        "a straight line does not show, before the next one, how abruptly its speed changes"
    )
    law: ClassVar[str] = "F += strength w/(2 pi f), w'' + 2 g w' + (g^2 + (2 pi f)^2)(w - a) = 0"
    seen: ClassVar[str] = "the force oscillates after each abrupt start and stop, at one frequency"
    reference: ClassVar[str] = "Den Hartog 1956, Mechanical Vibrations, ch. 2"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a strength scaled by the top speed."""
        shown = 1.0 / (READINGS_A_PERIOD * scales.shortest) if scales.shortest > 0.0 else _FASTEST
        highest = min(max(shown, 2.0 * SLOWEST_HZ), _FASTEST)
        speed = scales.speed if scales.speed > 0.0 else 1.0
        return cls(scales.positive(speed), LogUniform(SLOWEST_HZ, highest), LogUniform(*_DAMPING))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with that of the swinging mass added."""
        turn = 2.0 * math.pi * self.frequency
        swing = _impulses(motion, turn * (1j - self.damping))
        return below.force(motion) + self.strength * (1.0 + self.damping**2) * xp.imag(swing)

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        """Return why the records do not show it: speeds, or readings in a period, are missing."""
        if READINGS_A_PERIOD * SLOWEST_HZ * protocol.interval > 1.0:
            fewest = f"fewer than {READINGS_A_PERIOD:.0f} readings"
            return f"{fewest} fall in a period of {SLOWEST_HZ:.0f} Hz"
        return super().unmeasured(protocol)


def _impulses(motion: Motion, rate: Array) -> Array:
    """Return the integral of e^{rate (t - s)} dv(s) from rest at each point (N,), complex."""
    duration = xp.diff(motion.time)
    gained = motion.acceleration[:-1] * duration
    jumps = xp.diff(motion.velocity) - gained
    change = rate * duration
    # (e^x - 1)/x, whose series is exact to 1e-16 where the difference loses digits
    near = xp.abs(change) < 1e-5
    far = xp.where(near, 1.0, change)
    mean = xp.where(near, 1.0 + 0.5 * change, (xp.exp(far) - 1.0) / far)
    parts = xp.concatenate([motion.velocity[:1] + 0j, gained * mean + jumps])
    decay = xp.concatenate([np.ones(1) + 0j, xp.exp(change)])
    return xp.accumulate(_composed, (decay, parts))[1]


def _composed(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return decay and part of two steps, one after the other."""
    return first[0] * second[0], second[0] * first[1] + second[1]
