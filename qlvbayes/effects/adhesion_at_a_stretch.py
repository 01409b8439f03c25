"""Define adhesion at a stretch: ligaments follow the platen off the surface, then let go."""

from __future__ import annotations

from typing import ClassVar, Self

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qlvbayes.effects.adhesion import Adhesion
from qlvbayes.laws.layered import Law, State, line_at_depth, touching
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales, lognormal
from qlvbayes.priors.distributions import Constant

_SHARPNESS = 8.0  # nine tenths of the tension are lost between 1 and 1.3 stretches
_TORN = 3.0  # in stretches; beyond, less than e^-800 of the ligaments is left
_NO_STRETCH = 1e-12  # mm: shorter ligaments are torn as soon as they are pulled
_UNTOUCHED = 1e30  # mm, of a motion that has not touched the surface: nothing holds


class AdhesionAtAStretch(Adhesion):
    """Ligaments that pull beyond contact: F = F_adhesion where they pull less, -T g where more.

    T = strength e^{1/8} x/stretch, where x = max(-d, 0) is how far the platen has gone back beyond
    contact. With X its largest value since the last contact, g = e^{-(X/stretch)^8/8} is the share
    of the ligaments that holds, of the tension in F_adhesion, the force of adhesion, too. They pull
    most at X = ``stretch``, and are torn at 1.3 times that until the platen touches again. In tests
    that do not go beyond contact this is adhesion, and so it is at stretch 0, but for the tension
    that adhesion keeps beyond contact.

    * ``strength``: the largest tension (N), zero or more.
    * ``stretch``: distance beyond contact at which the surface lets go (mm), zero or more.
    """

    strength: Constant
    stretch: Constant
    name: ClassVar[str] = "adhesion_at_a_stretch"
    units: ClassVar[dict[str, str]] = {"strength": "force", "stretch": "displacement"}
    generalises: ClassVar[str] = Adhesion.name
    reduces: ClassVar[dict[str, float]] = {"stretch": 0.0}
    law: ClassVar[str] = "tension up to strength at a stretch beyond contact, then release"
    seen: ClassVar[str] = "negative force that grows until the platen is a distance off the surface"
    reference: ClassVar[str] = "Shull 2002, doi:10.1016/S0927-796X(01)00039-0"

    @classmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with the strength of adhesion and a stretch near 10 % of the depth."""
        return cls(scales.positive(1.0), lognormal(0.1 * scales.depth, 3.0))

    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force with adhesion and the ligaments' pull."""
        pull, farthest = jnp.maximum(-motion.displacement, 0.0), _farthest(motion.displacement)
        return self._with_ligaments(below.force(touching(motion)), pull, farthest)

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state of the law beneath, and how far the platen has been off the surface."""
        return super().begin(below, displacement), _at_first(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force with adhesion and the ligaments' pull."""
        inner, farthest = state
        inner, raw = below.step(inner, line_at_depth(line, line.displacement))
        pull = jnp.maximum(-line.displacement, 0.0)
        farthest = jnp.where(pull > 0.0, jnp.maximum(farthest, pull), 0.0)
        return (inner, farthest), self._with_ligaments(raw, pull, farthest)

    def _with_ligaments(self, raw: Array, pull: Array, farthest: Array) -> Array:
        stretch = self.stretch + _NO_STRETCH
        hold = jnp.exp(-(jnp.minimum(farthest / stretch, _TORN) ** _SHARPNESS) / _SHARPNESS)
        ligaments = jnp.exp(1.0 / _SHARPNESS) * jnp.minimum(pull / stretch, _TORN)
        sticking = self._with_limited_tension(raw)
        tension = jnp.minimum(sticking, -self.strength * ligaments)
        return jnp.where(tension < 0.0, hold * tension, sticking)


def _farthest(displacement: Array) -> Array:
    """Return how far (mm) the platen has been off the surface since it last touched, (N,)."""
    pull = jnp.maximum(-displacement[1:], 0.0)
    pulls = jnp.concatenate([_at_first(displacement[:1]), pull])
    return jax.lax.associative_scan(_since_contact, (displacement >= 0.0, pulls))[1]


def _at_first(displacement: Array) -> Array:
    return jnp.where(displacement < 0.0, _UNTOUCHED, 0.0)


def _since_contact(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return whether two parts of a motion touch, and the farthest since they last did."""
    (touched, before), (touches, after) = first, second
    return touched | touches, jnp.where(touches, after, jnp.maximum(before, after))
