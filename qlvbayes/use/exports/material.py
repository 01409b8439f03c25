"""A pad's constants as those of a material, for finite elements."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.io.checks import InputError
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.use.exports.card import NO_CONTACT, ONE_DRAW
from qlvbayes.use.exports.pad import ExportedPad
from qlvbayes.use.exports.target import Geometry

POISSON = 0.495  # wet soft solids hardly change volume; what ordinary elements still solve
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
