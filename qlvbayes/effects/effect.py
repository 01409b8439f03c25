"""Define the interface of effects. A new effect is one class."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, ClassVar, Self

from qlvbayes import xp
from qlvbayes.effects.history import duration
from qlvbayes.io.checks import InputError
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.priors import Normal
from qlvbayes.priors.distributions import Constant
from qlvbayes.pytree import Pytree, constant
from qlvbayes.xp import Array


class Level(IntEnum):
    """Levels on which effects act, from the inside out; they settle the order of nesting."""

    MATERIAL = 0
    SCALING = 1  # scales the material's force
    ADDING = 2  # adds to the pad's force
    CONTACT = 3
    DEPTH = 4  # changes the pad's depth, which may differ from the platen's displacement
    FRAME = 5
    GUIDE = 6  # adds to what the load cell feels, also where the pad is not touched
    SENSOR = 7
    CHANNEL = 8


@dataclass(frozen=True)
class Protocol:
    """Features of a study's tests that decide which effects the tests can show."""

    unloads: bool  # whether a test moves back
    returns: bool  # whether a test moves back to (nearly) zero depth
    tests: int  # how many tests there are
    bonded: bool  # whether the specimen is fixed to the platen
    curved: bool  # whether the displacement records give acceleration
    timed: bool = True  # whether the displacement records give velocity
    one_depth: bool = False  # whether there are holds and all are at one depth
    interval: float = 0.0  # sampling interval (s); 0 where it does not matter
    mass_shown: bool = False  # whether impulses at starts and stops show a moving mass


class AbstractEffect(Pytree):
    """Physical effect, which wraps the law beneath it and returns a force.

    Each field is a constant of the effect: a number where it is fixed, a prior where it is free; it
    is called ``name.field``. A class declares

    * ``name``: its name on the command line,
    * ``level`` and, within the level, ``rank``: where it nests,
    * ``units``: the kind of unit of each constant (a name that `UnitSystem.of` takes), unless its
      fields say them (`qlvbayes.pytree.constant`),
    * ``law``, ``seen`` and ``reference``: its formula, what a user would see, and its source, in
      one line each,

    and, where the default does not hold,

    * ``null``: the constants, each with its value, at which the effect vanishes exactly; the first
      is its amplitude. Else this is the first constant, at 0,
    * ``needs``: what its force is computed from, ``displacement``, ``velocity`` or
      ``acceleration``; records that do not give it cannot show the effect,
    * ``costly``: whether it evaluates the law beneath it several times, or at more points,
    * ``shapes``: at how many values of its first constant other than the amplitude a search looks
      at its force before it begins with the likeliest ones, where few would miss it,
    * ``generalises``: the name of the listed effect whose law it contains, at the values of the
      constants in ``reduces``; the other constants have the same names in both. One that acts off
      the pad, where the listed one does not, has its law in a specimen that is fixed to the platen,
    * ``off_pad``: whether it adds a force where the platen is off a pad that it has not touched,
    * ``outside``: whether it names nothing, but stands for whatever the list does not hold,
    * ``not_stepped``: why it has no ``step``, where it has none,
    * ``inverts``: whether the force after a step determines the displacement there, and
      ``not_inverted``: why it does not.
    """

    name: ClassVar[str]
    level: ClassVar[Level]
    units: ClassVar[dict[str, str]]
    null: ClassVar[dict[str, float]]
    law: ClassVar[str]
    seen: ClassVar[str]
    reference: ClassVar[str]
    rank: ClassVar[int] = 0
    needs: ClassVar[str] = "displacement"
    costly: ClassVar[bool] = False
    shapes: ClassVar[int] = 0
    generalises: ClassVar[str | None] = None
    reduces: ClassVar[dict[str, float]] = {}
    off_pad: ClassVar[bool] = False
    outside: ClassVar[bool] = False
    not_stepped: ClassVar[str] = "the effect does not say how it steps"
    inverts: ClassVar[bool] = True
    not_inverted: ClassVar[str] = "the effect does not say which displacement has a force"

    def __init_subclass__(cls, **options: Any) -> None:
        """Give the effect the null of most."""
        super().__init_subclass__(**options)
        own = fields(cls)
        if own and not hasattr(cls, "null"):
            cls.null = {own[0].name: 0.0}

    @classmethod
    def family(cls) -> str:
        """Return the name under which it is reported.

        That is the name of the listed effect that it generalises, or its own.
        """
        return cls.generalises or cls.name

    @property
    def prefix(self) -> str:
        """Return what precedes the constants' names, ``name.``."""
        return f"{self.name}."

    @classmethod
    @abstractmethod
    def default(cls, scales: Scales) -> Self:
        """Return the effect with every constant free, under priors at these scales."""

    @abstractmethod
    def force(self, below: Law, motion: Motion) -> Array:
        """Return the force (N,) in N of the law beneath with this effect, at the N points."""

    def begin(self, below: Law, displacement: Array) -> State:
        """Return the state at a motion's first point.

        It is the state of the law beneath where the effect has none of its own.
        """
        return below.begin(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """Return the state and the force (N) after a line; an effect may leave this out.

        The force is the one that ``force`` gives on a grid. Written in numbers and ``jnp``, this is
        also what the exports translate to C and to MATLAB. ``state`` is that before the line, of
        this effect and of the law ``below``. The pad's clock is 0 where the steps begin. An effect
        that has no step raises an InputError.
        """
        raise InputError(
            f"the effect {self.name} does not go step by step: {self.not_stepped}",
            remedy="leave it out of the model, or prescribe the displacement as a whole",
        )

    def spectrum(self, fractions: Array, rates: Array) -> tuple[Array, Array] | None:
        """Return a relaxation's spectrum as the effect changes it.

        None where the effect acts on more than the relaxation function. ``fractions`` (L + 1,)
        begin with the share that never relaxes, ``rates`` (L,) are in 1/s.
        """
        return None

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Return why no test of this protocol can show the effect, in a few words.

        None if one may.
        """
        return cls.unmeasured(protocol)

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        """Return why the displacement records do not give what the force is computed from."""
        if cls.needs == "velocity" and not protocol.timed:
            return "the displacement records do not give the speed"
        if cls.needs == "acceleration" and not protocol.curved:
            return "no acceleration is resolved"
        return None


class AbstractPointwise(AbstractEffect):
    """Effect on the force at each point, which follows from where the platen is, without a past."""

    @abstractmethod
    def changed(self, force: Array, now: Motion | Line, below: Law) -> Array:
        """Return what the force (N) of the law beneath becomes, at places and speeds ``now``."""

    def force(self, below: Law, motion: Motion) -> Array:
        return self.changed(below.force(motion), motion, below)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        state, force = below.step(state, line)
        return state, self.changed(force, line, below)


class AbstractClocked(AbstractEffect):
    """Effect that depends on the time (s) since the pad's first test began."""

    @abstractmethod
    def at_clock(self, force: Array, clock: Array) -> Array:
        """Return what a force (N) becomes at a time (s) of the pad's clock."""

    def force(self, below: Law, motion: Motion) -> Array:
        return self.at_clock(below.force(motion), motion.clock)

    def begin(self, below: Law, displacement: Array) -> State:
        return below.begin(displacement), xp.zeros_like(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        inner, clock = state
        inner, force = below.step(inner, line)
        clock = clock + line.duration
        return (inner, clock), self.at_clock(force, clock)


class AbstractCurve(AbstractEffect):
    """Effect of no known law: a curve over the study, size (P1 + quadratic P2 + cubic P3).

    P1, P2 and P3 are Legendre polynomials over the pad's clock.
    """

    size: Constant = constant("fraction", "size of the straight part, of either sign")
    quadratic: Constant = constant("count", "size of the part P2 over that of the straight one")
    cubic: Constant = constant("count", "size of the part P3 over that of the straight one")
    duration: Constant = constant("time", "duration of the study, which is fixed")
    outside = True
    reference = "Abramowitz & Stegun 1964, ch. 22"

    @classmethod
    def scaled(cls, scales: Scales, response: float) -> Self:
        """Return the effect; response: force (N) that the curve adds where it is one."""
        curved = Normal(0.0, 1.0), Normal(0.0, 1.0)
        return cls(scales.signed(_LARGEST * response), *curved, duration(scales))

    def curve(self, clock: Array) -> Array:
        """Return the curve at times (s) of the pad's clock, from 0 to the duration."""
        x = xp.clip(2.0 * clock / self.duration - 1.0, -1.0, 1.0)
        second, third = 0.5 * (3.0 * x**2 - 1.0), 0.5 * (5.0 * x**2 - 3.0) * x
        return self.size * (x + self.quadratic * second + self.cubic * third)


_LARGEST = 2.0
"""Largest value of P1 + quadratic P2 + cubic P3, within 50 %, at the priors' sd of both."""
