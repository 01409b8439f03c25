"""Define adhesion at a stretch: ligaments follow the platen off the surface, then let go."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from qlvbayes import xp
from qlvbayes.effects.adhesion import Adhesion
from qlvbayes.laws.layered import Law, State, line_at_depth, touching
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors import LogUniform
from qlvbayes.priors.distributions import Constant
from qlvbayes.xp import Array

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
