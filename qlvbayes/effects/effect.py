"""What every effect offers. A new effect is one class in one file."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Self

import equinox as eqx
from jaxtyping import Array

from qlvbayes.io.checks import InputError
from qlvbayes.laws.layered import Law, State
from qlvbayes.laws.motion import Line, Motion
from qlvbayes.laws.scales import Scales


class Level(IntEnum):
    """What an effect acts on, from the inside out: this settles the order of nesting."""

    MATERIAL = 0
    SCALING = 1  # of the material's force
    ADDING = 2  # to the pad's force
    CONTACT = 3
    DEPTH = 4  # of the pad, as against the platen's displacement
    FRAME = 5
    SENSOR = 6
    CHANNEL = 7


@dataclass(frozen=True)
class Protocol:
    """What the tests of a study do, as far as it decides which effects they can show.

    unloads: a test moves back; returns: a test moves back to (nearly) zero depth; tests: how many;
    bonded: whether the specimen is fixed to the platen; timed, curved: whether the displacement
    records give velocity and acceleration; one_depth: whether there are holds, all at one depth.
    """

    unloads: bool
    returns: bool
    tests: int
    bonded: bool
    curved: bool
    timed: bool = True
    one_depth: bool = False


class AbstractEffect(eqx.Module):
    """One physical effect that wraps the law beneath it, like middleware.

    A field is a constant: a number, or a prior while it is free. ``name`` as on the command line
    (constants are called ``name.field``); ``level`` and, within it, ``rank`` say where it nests;
    ``units`` names the kind of unit of each constant (`units.UnitSystem.of`); ``null`` gives the
    constants, each with its value, at which the effect vanishes exactly (the first is its
    amplitude); ``law``, ``seen``, ``reference``: for people, in one line each; ``needs``: what of
    the motion its force is made of: records that do not give it cannot show it; ``costly``:
    whether it runs the law beneath it several times, or over more points; ``generalises``: name of
    the listed effect whose law lies inside, where the constants in ``reduces`` have these values
    (the others have the same names in both); ``outside``: whether it names nothing, but stands for
    what no list holds; ``not_stepped``: why it has no ``step``, where it has none; ``inverts``:
    whether the force after a step tells the displacement there; ``not_inverted``: why it does not.
    """

    name: eqx.AbstractClassVar[str]
    level: eqx.AbstractClassVar[Level]
    units: eqx.AbstractClassVar[dict[str, str]]
    null: eqx.AbstractClassVar[dict[str, float]]
    law: eqx.AbstractClassVar[str]
    seen: eqx.AbstractClassVar[str]
    reference: eqx.AbstractClassVar[str]
    rank: ClassVar[int] = 0
    needs: ClassVar[str] = "displacement"
    costly: ClassVar[bool] = False
    generalises: ClassVar[str | None] = None
    reduces: ClassVar[dict[str, float]] = {}
    outside: ClassVar[bool] = False
    not_stepped: ClassVar[str] = "the effect does not say how it steps"
    inverts: ClassVar[bool] = True
    not_inverted: ClassVar[str] = "the effect does not say which displacement has a force"

    @classmethod
    def family(cls) -> str:
        """Name by which it is told: of the listed effect that it generalises, or its own."""
        return cls.generalises or cls.name

    @property
    def prefix(self) -> str:
        """What stands before the constants' names."""
        return f"{self.name}."

    @classmethod
    @abstractmethod
    def default(cls, scales: Scales) -> Self:
        """The effect with every constant free, under priors at these scales."""

    @abstractmethod
    def force(self, below: Law, motion: Motion) -> Array:
        """Force (N,) in N of the law beneath with this effect, at the motion's grid points."""

    def begin(self, below: Law, displacement: Array) -> State:
        """The state at a motion's first point; that of the law beneath, if it has none itself."""
        return below.begin(displacement)

    def step(self, below: Law, state: State, line: Line) -> tuple[State, Array]:
        """State and force (N) after a line, as ``force`` has it on a grid; may be left out.

        Written in numbers and ``jnp``, it is also what the exports translate to C and to MATLAB.
        The pad's clock is 0 where the steps begin. Raises InputError where there is no step.
        """
        raise InputError(
            f"the effect {self.name} does not go step by step: {self.not_stepped}",
            remedy="leave it out of the model, or prescribe the displacement as a whole",
        )

    def spectrum(self, fractions: Array, rates: Array) -> tuple[Array, Array] | None:
        """What it makes of a relaxation's fractions (L + 1,) and rates (L,), 1/s.

        None where it acts on more than the relaxation function.
        """
        return None

    @classmethod
    def blind(cls, protocol: Protocol) -> str | None:
        """Why no test of this protocol can show the effect, in a few words; None if one may."""
        return cls.unmeasured(protocol)

    @classmethod
    def unmeasured(cls, protocol: Protocol) -> str | None:
        """Why the displacement records do not give what the effect's force is made of."""
        if cls.needs == "velocity" and not protocol.timed:
            return "the displacement records do not give the speed"
        if cls.needs == "acceleration" and not protocol.curved:
            return "no acceleration is resolved"
        return None
