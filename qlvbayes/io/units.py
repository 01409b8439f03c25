"""Define systems of units, and the suffixes for units in column names.

Displacement and force stay in the units of the file; time is in s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class UnitSystem:
    """Units of displacement and force, from which all other units follow.

    Time is in s throughout. With force F and displacement d, K = m exp(b d) gives m the unit of
    force over displacement and b the unit of one over displacement.
    """

    displacement: str  # mm, um, nm or m, or 1 for strain
    force: str  # N, mN, uN or nN, or kPa, MPa or Pa for stress

    @property
    def dimensionless(self) -> bool:
        """Return whether displacement is a strain."""
        return self.displacement == "1"

    @property
    def displacement_name(self) -> str:
        """Return the word for displacement: ``displacement`` or ``strain``."""
        return "strain" if self.dimensionless else "displacement"

    @property
    def force_name(self) -> str:
        """Return the word for force: ``force`` or ``stress``."""
        return "stress" if self.dimensionless else "force"

    @property
    def stiffness(self) -> str:
        """Return the unit of m, force over displacement."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}"

    @property
    def power_stiffness(self) -> str:
        """Return the unit of the factor of a power law with exponent n."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}^n"

    @property
    def quadratic_stiffness(self) -> str:
        """Return the unit of force over the square of displacement."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}2"

    @property
    def cubic_stiffness(self) -> str:
        """Return the unit of force over the cube of displacement."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}3"

    @property
    def exponent(self) -> str:
        """Return the unit of b, one over displacement."""
        return "1" if self.dimensionless else f"1/{self.displacement}"

    @property
    def rate(self) -> str:
        """Return the unit of the relaxation rates v_i."""
        return "1/s"

    @property
    def speed(self) -> str:
        """Return the unit of the loading rate."""
        return f"{self.displacement}/s"

    @property
    def drag(self) -> str:
        """Return the unit of a drag coefficient, force over speed."""
        return f"{self.force} s" if self.dimensionless else f"{self.force} s/{self.displacement}"

    @property
    def power_drag(self) -> str:
        """Return the unit of the factor of a drag that grows as a power n of the speed."""
        return (
            f"{self.force} s^n" if self.dimensionless else f"{self.force} (s/{self.displacement})^n"
        )

    @property
    def mass(self) -> str:
        """Return the unit of a mass, force over acceleration; 1 N s2/mm is 1000 kg."""
        return f"{self.force} s2" if self.dimensionless else f"{self.force} s2/{self.displacement}"

    @property
    def compliance(self) -> str:
        """Return the unit of displacement over force."""
        return f"{self.displacement}/{self.force}"

    @property
    def force_rate(self) -> str:
        """Return the unit of a drift of the force."""
        return f"{self.force}/s"

    def of(self, kind: str) -> str:
        """Return the unit of a kind of constant: any property above, or time, fraction, count."""
        fixed = {"time": "s", "fraction": "1", "count": "1"}
        return fixed[kind] if kind in fixed else str(getattr(self, kind))

    def knows(self, kind: str) -> bool:
        """Return whether there is such a kind of constant."""
        try:
            self.of(kind)
        except AttributeError:
            return False
        return True

    @property
    def energy(self) -> str:
        """Return the unit of force times displacement."""
        if self.dimensionless:
            return f"{_JOULES[_EXPONENTS[self.force]]}/m3"
        return _JOULES[_EXPONENTS[self.force] + _EXPONENTS[self.displacement]]

    @property
    def mm_per_s(self) -> float:
        """Return 1 mm/s in this system's unit of speed; 1/s stays 1."""
        return 1.0 if self.dimensionless else 10.0 ** (-3 - _EXPONENTS[self.displacement])

    def factor_to(self, other: UnitSystem, kind: str) -> float:
        """Return the factor that converts a number of that kind to the other system's unit."""
        length, force = _DIMENSIONS[kind]
        way = 0 if self.dimensionless else _decades(self.displacement, other.displacement)
        return 10.0 ** (length * way + force * _decades(self.force, other.force))

    @property
    def bonded_default(self) -> bool:
        """Return whether the specimen can pull: a pad lies loose, a specimen in strain is glued."""
        return self.dimensionless


PAD = UnitSystem("mm", "N")
STRAIN = UnitSystem("1", "kPa")

# Powers of ten that convert to m, to N and to Pa.
_EXPONENTS = {
    "mm": -3, "um": -6, "nm": -9, "m": 0,
    "N": 0, "mN": -3, "uN": -6, "nN": -9,
    "kPa": 3, "MPa": 6, "Pa": 0,
}  # fmt: skip
_JOULES = {
    6: "MJ", 3: "kJ", 0: "J", -3: "mJ", -6: "uJ", -9: "nJ", -12: "pJ", -15: "fJ", -18: "aJ",
}  # fmt: skip
# Powers of displacement and of force in each kind of unit; the others have neither.
_DIMENSIONS = {
    "time": (0, 0),
    "rate": (0, 0),
    "fraction": (0, 0),
    "count": (0, 0),
    "displacement": (1, 0),
    "speed": (1, 0),
    "exponent": (-1, 0),
    "force": (0, 1),
    "force_rate": (0, 1),
    "stiffness": (-1, 1),
    "quadratic_stiffness": (-2, 1),
    "cubic_stiffness": (-3, 1),
    "drag": (-1, 1),
    "mass": (-1, 1),
    "compliance": (1, -1),
}


def unit_system(displacement: str, force: str) -> UnitSystem:
    """Return the system of these units; raise KeyError where they do not go together."""
    system = UnitSystem(displacement, force)
    known = _STRESS if system.dimensionless else _FORCE
    lengths = (STRAIN.displacement,) if system.dimensionless else tuple(_LENGTH)
    if displacement not in lengths or force not in known:
        raise KeyError(f"{displacement}, {force}")
    return system


def _decades(unit: str, other: str) -> int:
    return _EXPONENTS[unit] - _EXPONENTS[other]


@dataclass(frozen=True)
class Scale:
    """Exact ratio of two units: one of the column's units is up/down of another one."""

    up: int = 1
    down: int = 1

    def over(self, other: Scale) -> Scale:
        """Return the ratio of two ratios, in lowest terms."""
        up, down = self.up * other.down, self.down * other.up
        common = math.gcd(up, down)
        return Scale(up // common, down // common)

    def convert(self, values: NDArray[np.float64]) -> None:
        """Convert the values in place."""
        if self.up != 1:
            values *= self.up
        if self.down != 1:
            values /= self.down


SAME = Scale()

_TIME = {"s": SAME, "ms": Scale(down=1000), "min": Scale(up=60)}
_LENGTH = {
    "mm": SAME,
    "um": Scale(down=1000),
    "nm": Scale(down=1_000_000),
    "m": Scale(up=1000),
}
_FORCE = {
    "N": SAME,
    "mN": Scale(down=1000),
    "uN": Scale(down=1_000_000),
    "nN": Scale(down=1_000_000_000),
}
_STRESS = {"kPa": SAME, "MPa": Scale(up=1000), "Pa": Scale(down=1000)}

SUFFIXES: dict[str, dict[str, Scale]] = {
    "time": _TIME,
    "displacement": _LENGTH,
    "force": _FORCE,
    "force_sd": _FORCE,
    "strain": {"": SAME},
    "stress": _STRESS,
    "stress_sd": _STRESS,
    "start": _TIME,
    "contact_sd": _LENGTH,
    "rate": {**{f"{unit}_s": scale for unit, scale in _LENGTH.items()}, "1_s": SAME},
}
"""Suffixes of each quantity, the default one first, each with its ratio to the default."""


def column_name(quantity: str, suffix: str) -> str:
    """Return the column name of a quantity in a unit: 'force', 'mN' -> 'force_mN'."""
    return f"{quantity}_{suffix}" if suffix else quantity
