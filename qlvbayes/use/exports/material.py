"""A pad's constants as those of a material, for finite elements, and numbers for their decks."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from qlvbayes.io.checks import InputError
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.use.exports.card import NO_CONTACT, ONE_DRAW, card, commented
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import AbstractTarget, Geometry

POISSON = 0.495  # wet soft solids hardly change volume; what ordinary elements still solve
DENSITY = 1e-9  # t/mm3, water's: explicit solvers want one, and tests of force give none
FEWER_TERMS = "fit with --relaxation prony:3"
_MPA = 1e-3  # of a kPa

CANNOT = (
    NO_CONTACT,
    "stiffening with depth: the modulus is that of small strain",
    f"the volume's own stiffness, which tests do not give: Poisson's ratio {POISSON} is assumed",
    ONE_DRAW,
)
STRUCTURE = (
    "the shape: shares g and times apply to a material only for a homogeneous specimen; a "
    "fluid-filled pad is a structure, whose fluid takes part in what relaxes"
)


@dataclass(frozen=True)
class Moduli:
    """Elastic moduli of the fast limit, at small strain, in MPa (N/mm2)."""

    young: float

    @property
    def shear(self) -> float:
        """G = E/(2 (1 + nu))."""
        return self.young / (2.0 * (1.0 + POISSON))

    @property
    def bulk(self) -> float:
        """K = E/(3 (1 - 2 nu))."""
        return self.young / (3.0 * (1.0 - 2.0 * POISSON))


def moduli(pad: ExportedPad, specimen: Geometry | None) -> Moduli:
    """Return E: K(0) of stress over strain, or K(0) height/area of force over displacement.

    Uniaxial and at small strain. Raises InputError where the specimen's shape is wanted, or the law
    has no stiffness at first contact.
    """
    stiffness = pad.stiffness(0.0)
    if stiffness == 0.0:
        raise InputError(
            f"the elastic law {type(pad.elastic).name} has no stiffness at first contact, hence no "
            "modulus",
            remedy="use --to c, fmu or json",
        )
    if pad.units.dimensionless:
        return Moduli(stiffness * _MPA * pad.units.factor_to(STRAIN, "stiffness"))
    if specimen is None:
        raise InputError(
            f"pad {pad.name} has force over displacement, and a modulus needs its shape",
            remedy="give --height MM and --area MM2 of a homogeneous specimen",
        )
    return Moduli(
        stiffness * pad.units.factor_to(PAD, "stiffness") * specimen.height / specimen.area
    )


def structure(pad: ExportedPad) -> tuple[str, ...]:
    """Return the limits that a card states in addition to ``CANNOT``."""
    return () if pad.units.dimensionless else (STRUCTURE,)


def terms(pad: ExportedPad) -> list[tuple[float, float]]:
    """Return share and time (s) of each term that relaxes."""
    return list(zip(pad.fractions[1:].tolist(), pad.times.tolist(), strict=True))


class AbstractDeck(AbstractTarget):
    """Input of a solver: lines that describe a material, below the card in comments."""

    cannot = CANNOT
    mark: ClassVar[str]  # of a comment
    most: ClassVar[float] = math.inf  # terms
    long_term: ClassVar[bool] = False  # whether what never relaxes is one of the terms
    room: ClassVar[str] = ""  # how many terms there may be, in words

    def files(self, pad: ExportedPad, specimen: Geometry | None) -> dict[str, bytes]:
        """Return each file, the card on top; raise InputError where there are too many terms."""
        modulus = moduli(pad, specimen)
        if (count := pad.times.size + self.long_term) > self.most:
            raise InputError(
                f"{self.room}, and {pad.choices.relaxing} has {count}", remedy=FEWER_TERMS
            )
        head = commented(card(pad, type(self), structure(pad)), self.mark)
        return {
            f"{pad.identifier}{ending}": (head + "\n".join(lines) + "\n").encode()
            for ending, lines in self.lines(pad, modulus).items()
        }

    @abstractmethod
    def lines(self, pad: ExportedPad, modulus: Moduli) -> dict[str, list[str]]:
        """Return the lines of each file, by what follows the pad in its name."""


_DIGITS = 17  # after which a double is itself again
_WIDTH = 20  # columns of a long field


def column(value: float, width: int, exponent: str = "e") -> str:
    """Return a number right-aligned in its column; ``exponent``: empty for solvers that read 1.5-3.

    Raises InputError where not one digit has room.
    """
    for digits in range(_DIGITS, 0, -1):
        shortest = repr(value) if digits == _DIGITS else f"{value:.{digits}g}"
        mantissa, _, power = f"{value:#.{digits - 1}e}".partition("e")
        sign = "" if exponent else "+" if int(power) >= 0 else ""
        short = f"{mantissa.rstrip('0')}{exponent}{sign}{int(power)}"
        whole = shortest if "." in shortest else f"{shortest}."
        for text in (short,) if "e" in shortest else (whole, whole.lstrip("0"), short):
            if text != "." and len(text) <= width:
                return text.rjust(width)
    raise InputError(f"{value:g} has no room in {width} columns", remedy="use --to json")


def field(value: float) -> str:
    """Return a long field that begins with a blank, so that the eye separates it from the last."""
    return column(value, _WIDTH - 1).rjust(_WIDTH)
