"""Where a specimen is touched, lets go, or is touched again."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, Level, Protocol
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth, touching
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

_REST = 1e5  # s at zero displacement before the test
BEFORE = 2
"""Number of points that `rested` adds before a motion."""


class ContactOffset(AbstractEffect):
    """Contact that begins at another displacement: depth = max(displacement - gap, 0).

    A pad with a negative gap has rested at the depth -gap for long when its test begins.

    * ``gap``: displacement at which contact begins (mm), of either sign.
    """

    gap: Constant
    name: ClassVar[str] = "contact_offset"
    level: ClassVar[Level] = Level.DEPTH
    rank: ClassVar[int] = 1
    units: ClassVar[dict[str, str]] = {"gap": "displacement"}
    null: ClassVar[dict[str, float]] = {"gap": 0.0}
    law: ClassVar[str] = "delta -> max(delta - gap, 0)"
    seen: ClassVar[str] = "the toe of every ramp comes late, or a force stands before it"
    reference: ClassVar[str] = "Lin, Dimitriadis & Horkay 2007, doi:10.1115/1.2800826"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a gap scaled by the stiffness at the largest force."""
        return cls(scales.signed(scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath at the shifted depth."""
        known = rested(motion)
        return below.force(at_depth(known, known.displacement - self.gap))[BEFORE:]

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath after a long rest and a jump."""
        return begun_rested(self, below, xp.zeros_like(displacement) - self.gap, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force of the law beneath at the shifted depth."""
        return below.step(state, line_at_depth(line, line.displacement - self.gap))


def begun_rested(effect: AbstractEffect, below: Law, depth: Array, displacement: Array) -> State:
    """Return the state after a long rest at zero displacement, at the depth ``depth`` (mm)."""
    zero = xp.zeros_like(displacement)
    state = below.begin(xp.maximum(depth, 0.0))
    state, _ = effect.step(below, state, Line(zero + _REST, zero, zero))
    return effect.step(below, state, Line(zero, displacement, zero))[0]


def rested(motion: Motion) -> Motion:
    """Return the motion after a long rest at zero displacement and a jump to its first point."""
    rest, first = np.zeros(BEFORE), motion.time[:1]
    ago = motion.ago
    return replace(
        motion,
        time=xp.concatenate([first - _REST, first, motion.time]),
        displacement=xp.concatenate([rest, motion.displacement]),
        velocity=xp.concatenate([rest, motion.velocity]),
        acceleration=xp.concatenate([rest, motion.acceleration]),
        ago=None if ago is None else xp.concatenate([ago[:1]] * BEFORE + [ago]),
        sagitta=None if motion.sagitta is None else xp.concatenate([rest, motion.sagitta]),
    )


class GradualContact(AbstractEffect):
    """Contact that is made gradually: depth = max(d - gap (1 - e^{-d/over}), 0).

    In the exponent d is max(displacement, 0). At over = 0 a pad with a negative gap has rested, as
    in contact_offset.

    * ``gap``: how far the depth falls short once contact is full (mm), of either sign.
    * ``over``: depth over which contact is made (mm), zero or more.
    """

    gap: Constant
    over: Constant
    name: ClassVar[str] = "gradual_contact"
    level: ClassVar[Level] = ContactOffset.level
    rank: ClassVar[int] = ContactOffset.rank
    units: ClassVar[dict[str, str]] = {"gap": "displacement", "over": "displacement"}
    null: ClassVar[dict[str, float]] = {"gap": 0.0}
    generalises: ClassVar[str] = ContactOffset.name
    reduces: ClassVar[dict[str, float]] = {"over": 0.0}
    law: ClassVar[str] = "delta -> max(delta - gap (1 - e^(-delta/over)), 0)"
    seen: ClassVar[str] = "the toe of every ramp is longer and rounder, or shorter"
    reference: ClassVar[str] = "Fung 1993, Biomechanics, ch. 7.3, the toe region"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a gap scaled by the stiffness at the largest force."""
        return cls(scales.signed(scales.stiffness), lognormal(0.1 * scales.depth, 3.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force of the law beneath at the changed depth, speed and acceleration."""
        known = rested(motion)
        depth, slope, over = self._contact_depth(known.displacement)
        changed = replace(
            known,
            velocity=known.velocity * (1.0 - slope),
            acceleration=known.acceleration * (1.0 - slope) + known.velocity**2 * slope / over,
        )
        return below.force(at_depth(changed, depth))[BEFORE:]

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath after a long rest and a jump."""
        depth, _, _ = self._contact_depth(xp.zeros_like(displacement))
        return begun_rested(self, below, depth, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force of the law beneath at the changed depth and speed."""
        depth, slope, _ = self._contact_depth(line.displacement)
        changed = replace(line, velocity=line.velocity * (1.0 - slope))
        return below.step(state, line_at_depth(changed, depth))

    def _contact_depth(self, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the depth (may be below 0), the relative loss of speed, and ``over`` (mm)."""
        gradual = self.over > 0.0
        over = xp.where(gradual, self.over, 1.0)
        missing = xp.exp(-xp.maximum(displacement, 0.0) / over)
        missing = xp.where(gradual, missing, 0.0)
        slope = xp.where(displacement > 0.0, self.gap / over * missing, 0.0)
        return displacement - self.gap * (1.0 - missing), slope, over


_RANGE = (
    0.1,
    0.95,
)  # shares of the largest depth: nearer to its ends it is another elastic law, or not visible


class SecondContact(AbstractEffect):
    """Second spring beyond a depth: F = F_below + stiffness max(d - depth, 0).

    The second spring does not relax.

    * ``stiffness``: its stiffness (N/mm), zero or more.
    * ``depth``: depth at which it is reached (mm).
    """

    stiffness: Constant
    depth: Constant
    name: ClassVar[str] = "second_contact"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 5
    units: ClassVar[dict[str, str]] = {"stiffness": "stiffness", "depth": "displacement"}
    null: ClassVar[dict[str, float]] = {"stiffness": 0.0}
    law: ClassVar[str] = "F += stiffness max(delta - depth, 0)"
    seen: ClassVar[str] = "stiffer at once beyond a depth, at any speed, also after long holds"
    reference: ClassVar[str] = "Gibson & Ashby 1997, Cellular Solids, ch. 5, densification"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a stiffness scaled by half of the depth."""
        low, high = (share * scales.depth for share in _RANGE)
        return cls(scales.positive(0.5 * scales.depth), Uniform(low, high))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with the second spring added."""
        return below.force(motion) + self._spring(motion.displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with the second spring added."""
        state, force = below.step(state, line)
        return state, force + self._spring(line.displacement)

    def _spring(self, depth: Array) -> Array:
        return self.stiffness * xp.maximum(depth - self.depth, 0.0)


_GONE = 40.0  # in strengths; beyond, less than e^-294 of the tension is left


class Adhesion(AbstractEffect):
    """Tension of the surface: F = F_below e^{-(F_below/strength)^2/(2e)} where F_below < 0.

    Where F_below is positive, F = F_below. The surface carries tension up to ``strength`` and lets
    go beyond. This is a cohesive law, the same on release and on renewed contact. At strength 0 the
    force is never negative, which is the contact of a loose specimen that this effect replaces.

    * ``strength``: the largest tension (N), zero or more.
    """

    strength: Constant
    name: ClassVar[str] = "adhesion"
    level: ClassVar[Level] = Level.CONTACT
    units: ClassVar[dict[str, str]] = {"strength": "force"}
    null: ClassVar[dict[str, float]] = {"strength": 0.0}
    inverts: ClassVar[bool] = False
    not_inverted: ClassVar[str] = (
        "while the surface lets go, one tension is that of two displacements"
    )
    law: ClassVar[str] = "tension up to strength on retraction, then release"
    seen: ClassVar[str] = "negative force when the platen retracts, then none"
    reference: ClassVar[str] = "Xu & Needleman 1993, doi:10.1088/0965-0393/1/2/003"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with a strength scaled by the peak force."""
        return cls(scales.positive(1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with tension limited by the strength."""
        return self._with_limited_tension(below.force(touching(motion)))

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath at the specimen's depth."""
        return below.begin(xp.maximum(displacement, 0.0))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with tension limited by the strength."""
        state, raw = below.step(state, line_at_depth(line, line.displacement))
        return state, self._with_limited_tension(raw)

    def _with_limited_tension(self, raw: Array) -> Array:
        gone = raw <= -_GONE * self.strength  # there the ratio or its square may not be finite
        ratio = xp.where(gone, 0.0, raw) / xp.where(self.strength > 0.0, self.strength, 1.0)
        tension = xp.where(gone, 0.0, raw * xp.exp(-(ratio**2) / (2.0 * math.e)))
        return xp.where(raw > 0.0, raw, tension)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test can show it: it needs a loose specimen and full retraction."""
        if protocol.bonded:
            return "the specimen is fixed to the platen"
        return None if protocol.returns else "no test retracts to zero depth"


_SHARPNESS = 8.0  # nine tenths of the tension are lost between 1 and 1.3 stretches
_TORN = 3.0  # in stretches; beyond, less than e^-800 of the ligaments is left
_NO_STRETCH = 1e-12  # mm: shorter ligaments are torn as soon as they are pulled
_UNTOUCHED = 1e30  # mm, of a motion that has not touched the surface: nothing holds


class AdhesionAtAStretch(Adhesion):
    """Ligaments that pull beyond contact: F = F_adhesion where they pull less, -T g where more.

    T = strength e^{1/8} x/stretch, where x = max((1 - recovered) d_0 - d, 0) is how far the platen
    has gone back beyond the surface. That of a pad which has not recovered is at the displacement
    d_0 where its own force last fell to zero, and at rest, recovered 1, it is at d = 0. With X the
    largest x since the platen touched, g = e^{-(X/stretch)^8/8} is the share of the ligaments
    that holds, of the tension in F_adhesion, the force of adhesion, too. They pull most at X =
    ``stretch``, and are torn at 1.3 times that until the platen touches again. Where the platen
    does not go beyond the surface this is adhesion, and so it is at stretch 0, but for the tension
    that adhesion keeps beyond it.

    * ``strength``: the largest tension (N), zero or more.
    * ``stretch``: distance beyond the surface at which it lets go (mm), zero or more.
    * ``recovered``: how far the surface is back at rest, from 0 (where the force ends) to 1.
    """

    strength: Constant
    stretch: Constant
    recovered: Constant = 1.0
    name: ClassVar[str] = "adhesion_at_a_stretch"
    units: ClassVar[dict[str, str]] = {
        "strength": "force",
        "stretch": "displacement",
        "recovered": "fraction",
    }
    generalises: ClassVar[str] = Adhesion.name
    reduces: ClassVar[dict[str, float]] = {"stretch": 0.0, "recovered": 1.0}
    law: ClassVar[str] = "tension up to strength at a stretch beyond contact, then release"
    seen: ClassVar[str] = "negative force that grows until the platen is a distance off the surface"
    reference: ClassVar[str] = "Shull 2002, doi:10.1016/S0927-796X(01)00039-0"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with the strength of adhesion and a stretch near 10 % of the depth."""
        return cls(scales.positive(1.0), lognormal(0.1 * scales.depth, 3.0), LogUniform(0.01, 1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with adhesion and the ligaments' pull."""
        raw = below.force(touching(motion))
        surface = (1.0 - self.recovered) * _last_touched(motion.displacement, raw)
        off = xp.maximum(surface - motion.displacement, 0.0)
        return self._with_ligaments(raw, off, _farthest(off))

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state beneath, where the pad was touched, and how far the platen was off."""
        touched = xp.maximum(displacement, 0.0)
        return super().begin(below, displacement), (touched, np.zeros(()), _at_first(displacement))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with adhesion and the ligaments' pull."""
        inner, (touched, before, farthest) = state
        start = line.displacement - line.velocity * line.duration
        inner, raw = below.step(inner, line_at_depth(line, line.displacement))
        ends = _crossing(before, raw, start, line.displacement)
        touched = xp.where(raw > 0.0, line.displacement, xp.where(before > 0.0, ends, touched))
        off = xp.maximum((1.0 - self.recovered) * touched - line.displacement, 0.0)
        farthest = xp.where(off > 0.0, xp.maximum(farthest, off), 0.0)
        return (inner, (touched, raw, farthest)), self._with_ligaments(raw, off, farthest)

    def _with_ligaments(self, raw: Array, pull: Array, farthest: Array) -> Array:
        stretch = self.stretch + _NO_STRETCH
        hold = xp.exp(-(xp.minimum(farthest / stretch, _TORN) ** _SHARPNESS) / _SHARPNESS)
        ligaments = xp.exp(1.0 / _SHARPNESS) * xp.minimum(pull / stretch, _TORN)
        sticking = self._with_limited_tension(raw)
        tension = xp.minimum(sticking, -self.strength * ligaments)
        return xp.where(tension < 0.0, hold * tension, sticking)


def _last_touched(displacement: Array, raw: Array) -> Array:
    """Return the displacement (N,) at which a pad's own force raw (N,) last was above zero."""
    ends = _crossing(raw[:-1], raw[1:], displacement[:-1], displacement[1:])
    pressed = raw > 0.0
    known = pressed | xp.concatenate([np.ones(1, dtype=bool), raw[:-1] > 0.0])
    first = xp.maximum(displacement[:1], 0.0)
    places = xp.where(pressed, displacement, xp.concatenate([first, ends]))
    return xp.accumulate(_latest, (known, places))[1]


def _crossing(before: Array, after: Array, start: Array, end: Array) -> Array:
    """Return where a force that falls from before to after along a line is zero."""
    falls = (before > 0.0) & (after <= 0.0)
    share = xp.where(falls, before, 0.0) / xp.where(falls, before - after, 1.0)
    return start + share * (end - start)


def _latest(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return whether two parts of a motion know a place, and the later place that is known."""
    (known, before), (knows, after) = first, second
    return known | knows, xp.where(knows, after, before)


def _farthest(off: Array) -> Array:
    """Return how far (mm) the platen has been off the surface since it last touched, (N,)."""
    pulls = xp.concatenate([xp.where(off[:1] > 0.0, _UNTOUCHED, 0.0), off[1:]])
    return xp.accumulate(_since_contact, (off <= 0.0, pulls))[1]


def _at_first(displacement: Array) -> Array:
    return xp.where(displacement < 0.0, _UNTOUCHED, 0.0)


def _since_contact(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return whether two parts of a motion touch, and the farthest since they last did."""
    (touched, before), (touches, after) = first, second
    return touched | touches, xp.where(touches, after, xp.maximum(before, after))
