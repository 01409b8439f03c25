"""The rig's frame: it yields, rings, or has play."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.effects.history import dragged
from qlvbayes.io.catalogue import READINGS_A_PERIOD, SLOWEST_HZ
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array

_STEPS = 4  # quasi-Newton steps; their slope is right to a few per cent


class FrameCompliance(AbstractEffect):
    """Frame that deflects in proportion to the force: depth = displacement - compliance F.

    The force is solved at all points at once by quasi-Newton steps with the instantaneous elastic
    stiffness at the platen's displacement: four steps give 1e-5 of the peak for a frame ten times
    as stiff as the pad. The frame's own speed is neglected against the platen's.
    """

    compliance: Constant = constant("compliance", "one over the frame's stiffness, zero or more")
    name = "frame_compliance"
    level = Level.FRAME
    costly = True
    law = "delta -> delta - compliance F"
    seen = "softer in proportion to force"
    reference = "Oliver & Pharr 1992, doi:10.1557/JMR.1992.1564"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # its sd is 2.5 % of the pad's own compliance: a frame as soft as a pad lies at 40 sd
        return cls(scales.positive(2.0 * scales.force**2 / scales.depth))

    def deflection(self, force: Array) -> tuple[Array, Array]:
        """Return the frame's deflection (mm) at a force (N), and its slope (mm/N)."""
        return self.compliance * force, self.compliance

    def force(self, below: Law, motion: Motion) -> Array:
        slope = self._slope(below, motion.displacement)
        force = below.force(motion) / (1.0 + slope)  # as if nothing yielded yet
        for _ in range(_STEPS - 1):  # no scan: the law beneath is compiled by itself
            depth = motion.displacement - self.deflection(force)[0]
            answer = below.force(replace(motion, displacement=depth))
            force = (answer + slope * force) / (1.0 + slope)
        return force

    def begin(self, below: Law, displacement: Array) -> State:
        # each Newton step has a motion of its own
        zero, slope = xp.zeros_like(displacement), self._slope(below, displacement)
        force, states = zero, []
        for _ in range(_STEPS):
            depth = displacement - self.deflection(force)[0]
            states.append(below.begin(depth))
            _, answer = below.step(states[-1], Line(zero, depth, zero))
            force = (answer + slope * force) / (1.0 + slope)
        return tuple(states)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        force, moved = xp.zeros_like(line.displacement), []
        slope = self._slope(below, line.displacement)
        for one in state:
            depth = line.displacement - self.deflection(force)[0]
            one, answer = below.step(one, replace(line, displacement=depth))
            moved.append(one)
            force = (answer + slope * force) / (1.0 + slope)
        return tuple(moved), force

    def _slope(self, below: Law, displacement: Array) -> Array:
        """Return the frame's compliance times the pad's stiffness, before the frame yields."""
        _, compliance = self.deflection(xp.zeros_like(displacement))
        return compliance * below.elastic.stiffness(displacement)


class StiffeningFrame(FrameCompliance):
    """Deflection of a stiffening frame: depth = displacement - compliance F/(1 + abs(F)/stiff).

    F is the force itself; it is solved as for a frame that does not stiffen.
    """

    compliance: Constant = constant("compliance", "compliance of the unloaded frame, zero or more")
    stiff: Constant = constant(
        "force", "force at which the deflection is half that of a frame that does not stiffen"
    )
    name = "stiffening_frame"
    generalises = FrameCompliance.name
    reduces: ClassVar[dict[str, float]] = {"stiff": math.inf}
    law = "delta -> delta - compliance F/(1 + |F|/stiff)"
    seen = "softer where the force is small, less so where it is large"
    reference = "Kalidindi, Abusafieh & El-Danaf 1997, Exp. Mech. 37"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(scales.force**2 / scales.depth), lognormal(scales.force, 3.0))

    def deflection(self, force: Array) -> tuple[Array, Array]:
        softness = 1.0 / (1.0 + xp.abs(force) / self.stiff)
        return self.compliance * softness * force, self.compliance * softness**2


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
    """

    strength: Constant = constant(
        "drag", "force that rings for each unit by which the speed changes, zero or more"
    )
    frequency: Constant = constant("rate", "frequency of the ringing")
    damping: Constant = constant(
        "fraction", "its decay in the time of a radian, 0.1 a loss of 47 % in a period"
    )
    name = "frame_ringing"
    level = Level.SENSOR
    rank = -1  # within what the load cell's own errors act on
    off_pad = True
    needs = "velocity"
    shapes = 24
    not_stepped = (
        "a straight line does not show, before the next one, how abruptly its speed changes"
    )
    law = "F += strength w/(2 pi f), w'' + 2 g w' + (g^2 + (2 pi f)^2)(w - a) = 0"
    seen = "the force oscillates after each abrupt start and stop, at one frequency"
    reference = "Den Hartog 1956, Mechanical Vibrations, ch. 2"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        shown = 1.0 / (READINGS_A_PERIOD * scales.shortest) if scales.shortest > 0.0 else _FASTEST
        highest = min(max(shown, 2.0 * SLOWEST_HZ), _FASTEST)
        return cls(
            scales.positive(scales.top_speed),
            LogUniform(SLOWEST_HZ, highest),
            LogUniform(*_DAMPING),
        )

    def force(self, below: Law, motion: Motion) -> Array:
        turn = 2.0 * math.pi * self.frequency
        swing = _impulses(motion, turn * (1j - self.damping))
        return below.force(motion) + self.strength * (1.0 + self.damping**2) * xp.imag(swing)

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        if READINGS_A_PERIOD * SLOWEST_HZ * protocol.interval > 1.0:
            return (
                f"fewer than {READINGS_A_PERIOD:.0f} readings fall in a period of "
                f"{SLOWEST_HZ:.0f} Hz"
            )
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


class Backlash(AbstractEffect):
    """Play of the drive when it turns: the depth is p = min(max(p_before, d), d + play).

    On the way in the platen is where the encoder says. This is the play operator.
    """

    play: Constant = constant(
        "displacement",
        "distance that the drive moves back before the platen follows, zero or more",
    )
    name = "backlash"
    level = Level.DEPTH
    rank = 2
    inverts = False
    not_inverted = "while the platen waits the drive may be anywhere in the play"
    law = "delta -> p, p' = 0 until delta leaves [p - play, p]"
    seen = "after each turn of the drive the force waits before it follows"
    reference = "Visintin 1994, doi:10.1007/978-3-662-11557-2, ch. III, play"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        depth = dragged(motion.displacement, 0.0, self.play)
        waits = self._waits(depth, motion.displacement)
        return below.force(motion.followed(depth, lambda rate: xp.where(waits, 0.0, rate)))

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), displacement

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, depth = state
        depth = xp.clip(depth, line.displacement, line.displacement + self.play)
        waits = self._waits(depth, line.displacement)
        speed = xp.where(waits, 0.0, line.velocity)
        inner, force = below.step(inner, replace(line, displacement=depth, velocity=speed))
        return (inner, depth), force

    def _waits(self, depth: Array, displacement: Array) -> Array:
        """Return whether the platen is inside the play, in contact with neither of its ends."""
        # exact: a platen at one end of the play was set to that very number
        return (depth > displacement) & (depth < displacement + self.play)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return None if protocol.unloads else "no test unloads"
