"""Where a specimen is touched, slides, lets go, or is touched again."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.effect import AbstractEffect, AbstractPointwise, Level, Protocol
from qlvbayes.effects.history import fading, travelled
from qlvbayes.laws.elastic.polynomial import Linear
from qlvbayes.laws.hereditary import at_first, hereditary_force, hereditary_step
from qlvbayes.laws.layered import Law, State, at_depth, line_at_depth, touching
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform, Uniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import constant
from qlvbayes.xp import Array

_REST = 1e5  # s at zero displacement before the test

_BEFORE = 2  # points that this rest adds before a motion


class ContactOffset(AbstractEffect):
    """Contact that begins at another displacement: depth = max(displacement - gap, 0).

    A pad with a negative gap has rested at the depth -gap for long when its test begins.
    """

    gap: Constant = constant("displacement", "displacement at which contact begins, of either sign")
    name = "contact_offset"
    level = Level.DEPTH
    rank = 1
    law = "delta -> max(delta - gap, 0)"
    seen = "the toe of every ramp comes late, or a force stands before it"
    reference = "Lin, Dimitriadis & Horkay 2007, doi:10.1115/1.2800826"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        known = _rested(motion)
        return below.force(at_depth(known, known.displacement - self.gap))[_BEFORE:]

    def begin(self, below: Law, displacement: Array) -> State:
        zero = xp.zeros_like(displacement)
        state = below.begin(xp.maximum(self.depth_at(zero), 0.0))
        state, _ = self.step(below, state, Line(zero + _REST, zero, zero))
        return self.step(below, state, Line(zero, displacement, zero))[0]

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        return below.step(state, line_at_depth(line, line.displacement - self.gap))

    def depth_at(self, displacement: Array) -> Array:
        """Return the depth (mm), which may be below 0."""
        return displacement - self.gap


def _rested(motion: Motion) -> Motion:
    """Return the motion after a long rest at zero displacement and a jump to its first point."""
    first, ago = motion.time[:1], motion.ago

    def after_rest(values: Array) -> Array:
        return xp.concatenate([np.zeros(_BEFORE), values])

    return replace(
        motion.followed(after_rest(motion.displacement), after_rest),
        time=xp.concatenate([first - _REST, first, motion.time]),
        ago=None if ago is None else xp.concatenate([ago[:1]] * _BEFORE + [ago]),
    )


class GradualContact(ContactOffset):
    """Contact that is made gradually: depth = max(d - gap (1 - e^{-d/over}), 0).

    In the exponent d is max(displacement, 0). At over = 0 a pad with a negative gap has rested, as
    in contact_offset.
    """

    gap: Constant = constant(
        "displacement", "how far the depth falls short once contact is full, of either sign"
    )
    over: Constant = constant("displacement", "depth over which contact is made, zero or more")
    name = "gradual_contact"
    generalises = ContactOffset.name
    reduces: ClassVar[dict[str, float]] = {"over": 0.0}
    law = "delta -> max(delta - gap (1 - e^(-delta/over)), 0)"
    seen = "the toe of every ramp is longer and rounder, or shorter"
    reference = "Fung 1993, Biomechanics, ch. 7.3, the toe region"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.signed(scales.stiffness), lognormal(0.1 * scales.depth, 3.0))

    def force(self, below: Law, motion: Motion) -> Array:
        known = _rested(motion)
        slope, over = self._slope(known.displacement)
        changed = replace(
            known,
            velocity=known.velocity * (1.0 - slope),
            acceleration=known.acceleration * (1.0 - slope) + known.velocity**2 * slope / over,
        )
        return below.force(at_depth(changed, self.depth_at(known.displacement)))[_BEFORE:]

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        slope, _ = self._slope(line.displacement)
        changed = replace(line, velocity=line.velocity * (1.0 - slope))
        return below.step(state, line_at_depth(changed, self.depth_at(line.displacement)))

    def depth_at(self, displacement: Array) -> Array:
        return displacement - self.gap * (1.0 - self._missing(displacement)[0])

    def _slope(self, displacement: Array) -> tuple[Array, Array]:
        """Return the relative loss of speed, and ``over`` (mm)."""
        missing, over = self._missing(displacement)
        return xp.where(displacement > 0.0, self.gap / over * missing, 0.0), over

    def _missing(self, displacement: Array) -> tuple[Array, Array]:
        """Return the share of the contact that is missing, and ``over``, or 1 in place of 0."""
        gradual = self.over > 0.0
        over = xp.where(gradual, self.over, 1.0)
        return xp.where(gradual, xp.exp(-xp.maximum(displacement, 0.0) / over), 0.0), over


_RANGE = (0.1, 0.95)

"""Shares of the largest depth: nearer to its ends it is another elastic law, or not visible."""


class SecondContact(AbstractPointwise):
    """Second spring beyond a depth: F = F_below + stiffness max(d - depth, 0).

    The second spring does not relax.
    """

    stiffness: Constant = constant("stiffness", "its stiffness, zero or more")
    depth: Constant = constant("displacement", "depth at which it is reached")
    name = "second_contact"
    level = Level.ADDING
    rank = 5
    law = "F += stiffness max(delta - depth, 0)"
    seen = "stiffer at once beyond a depth, at any speed, also after long holds"
    reference = "Gibson & Ashby 1997, Cellular Solids, ch. 5, densification"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        low, high = (share * scales.depth for share in _RANGE)
        return cls(scales.positive(0.5 * scales.depth), Uniform(low, high))

    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        return force + self.stiffness * xp.maximum(now.displacement - self.depth, 0.0)


_GONE = 40.0  # in strengths; beyond, less than e^-294 of the tension is left


class Adhesion(AbstractEffect):
    """Tension of the surface: F = F_below e^{-(F_below/strength)^2/(2e)} where F_below < 0.

    Where F_below is positive, F = F_below. The surface carries tension up to ``strength`` and lets
    go beyond. This is a cohesive law, the same on release and on renewed contact. At strength 0 the
    force is never negative, which is the contact of a loose specimen that this effect replaces.
    """

    strength: Constant = constant("force", "the largest tension, zero or more")
    name = "adhesion"
    level = Level.CONTACT
    inverts = False
    not_inverted = "while the surface lets go, one tension is that of two displacements"
    law = "tension up to strength on retraction, then release"
    seen = "negative force when the platen retracts, then none"
    reference = "Xu & Needleman 1993, doi:10.1088/0965-0393/1/2/003"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        return self._with_limited_tension(below.force(touching(motion)))

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(xp.maximum(displacement, 0.0))

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        state, raw = below.step(state, line_at_depth(line, line.displacement))
        return state, self._with_limited_tension(raw)

    def _with_limited_tension(self, raw: Array) -> Array:
        gone = raw <= -_GONE * self.strength  # there the ratio or its square may not be finite
        ratio = xp.where(gone, 0.0, raw) / xp.where(self.strength > 0.0, self.strength, 1.0)
        tension = xp.where(gone, 0.0, raw * xp.exp(-(ratio**2) / (2.0 * math.e)))
        return xp.where(raw > 0.0, raw, tension)

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
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
    """

    strength: Constant = constant("force", "the largest tension, zero or more")
    stretch: Constant = constant(
        "displacement", "distance beyond the surface at which it lets go, zero or more"
    )
    recovered: Constant = constant(
        "fraction",
        "how far the surface is back at rest, from 0 (where the force ends) to 1",
        default=1.0,
    )
    name = "adhesion_at_a_stretch"
    generalises = Adhesion.name
    reduces: ClassVar[dict[str, float]] = {"stretch": 0.0, "recovered": 1.0}
    law = "tension up to strength at a stretch beyond contact, then release"
    seen = "negative force that grows until the platen is a distance off the surface"
    reference = "Shull 2002, doi:10.1016/S0927-796X(01)00039-0"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        return cls(scales.positive(1.0), lognormal(0.1 * scales.depth, 3.0), LogUniform(0.01, 1.0))

    def force(self, below: Law, motion: Motion) -> Array:
        raw = below.force(touching(motion))
        surface = (1.0 - self.recovered) * _last_touched(motion.displacement, raw)
        off = xp.maximum(surface - motion.displacement, 0.0)
        return self._with_ligaments(raw, off, _farthest(off))

    def begin(self, below: Law, displacement: Array) -> State:
        touched = xp.maximum(displacement, 0.0)
        off = xp.where(displacement < 0.0, _UNTOUCHED, 0.0)
        return super().begin(below, displacement), (touched, np.zeros(()), off)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
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


def _since_contact(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return whether two parts of a motion touch, and the farthest since they last did."""
    (touched, before), (touches, after) = first, second
    return touched | touches, xp.where(touches, after, xp.maximum(before, after))


class InterfaceSlip(AbstractEffect):
    """Sliding of the specimen in its grips: its depth e follows de = (1 - yielding e sgn v) dd.

    It slides a little from the start, and as much as the platen moves where e has come to
    1/yielding, whose elastic force is the most that the interface transmits. At a turn it sticks
    again, and it is back at rest before the platen is. Over the distance travelled e is one
    relaxing mode. A loose specimen, which is pressed across its faces, does not slide.
    """

    yielding: Constant = constant(
        "exponent", "share of the motion that is lost for each unit of depth, zero or more"
    )
    name = "interface_slip"
    level = Level.DEPTH
    rank = -1  # the drive's play and the gap lie outside of the specimen's faces
    law = "delta -> e, de = (1 - yielding e sgn v) d delta"
    seen = "softer the farther it goes, stiff at each turn, and back at rest too early"
    reference = "Mindlin & Deresiewicz 1953, doi:10.1115/1.4010702; Dahl 1968"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        # with one return it is permanent_set to 0.99, whatever the prior: both lose depth on the
        # way; a second loading tells, as the set is there already and the slip begins anew
        return cls(scales.positive(0.5 * scales.depth**2 * scales.stiffness))

    def force(self, below: Law, motion: Motion) -> Array:
        way = travelled(motion.displacement)
        depth = hereditary_force(*self._sliding, way, motion.displacement)
        share = self._followed(depth, motion.velocity)
        return below.force(motion.followed(depth, lambda rate: share * rate))

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), at_first(*self._sliding, displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, slide = state
        way = xp.abs(line.displacement - slide.depth)
        slide, depth = hereditary_step(*self._sliding, slide, way, line.displacement)
        speed = self._followed(depth, line.velocity) * line.velocity
        inner, force = below.step(inner, replace(line, displacement=depth, velocity=speed))
        return (inner, slide), force

    @property
    def _sliding(self) -> tuple[Linear, Prony]:
        """The laws whose hereditary integral over the distance travelled is the depth."""
        return fading(1.0, self.yielding)

    def _followed(self, depth: Array, velocity: Array) -> Array:
        """Return the share of the platen's motion that the specimen follows."""
        return 1.0 - self.yielding * depth * xp.sign(velocity)

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        return None if protocol.bonded else "the specimen is pressed, not held by its faces"

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        return cls.unmeasured(protocol) or (None if protocol.unloads else "no test unloads")
