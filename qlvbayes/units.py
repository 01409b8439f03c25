"""The two systems of units, and the unit suffixes a column name may carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class UnitSystem:
    """What stands for displacement and force, and the units that follow from them.

    Time is in s throughout. With force F and displacement d, K = m exp(b d) gives m the unit
    of force over displacement and b the unit of one over displacement.
    """

    displacement: str
    force: str
    displacement_name: str
    force_name: str

    @property
    def dimensionless(self) -> bool:
        """Whether displacement is a strain."""
        return self.displacement == "1"

    @property
    def stiffness(self) -> str:
        """Unit of m."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}"

    @property
    def power_stiffness(self) -> str:
        """Unit of the factor of a power law with exponent n."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}^n"

    @property
    def quadratic_stiffness(self) -> str:
        """Unit of force over the square of displacement."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}2"

    @property
    def cubic_stiffness(self) -> str:
        """Unit of force over the cube of displacement."""
        return self.force if self.dimensionless else f"{self.force}/{self.displacement}3"

    @property
    def exponent(self) -> str:
        """Unit of b."""
        return "1" if self.dimensionless else f"1/{self.displacement}"

    @property
    def rate(self) -> str:
        """Unit of the relaxation rates v_i."""
        return "1/s"

    @property
    def speed(self) -> str:
        """Unit of the loading rate."""
        return f"{self.displacement}/s"

    @property
    def drag(self) -> str:
        """Unit of a drag coefficient, force over speed."""
        return f"{self.force} s" if self.dimensionless else f"{self.force} s/{self.displacement}"

    @property
    def mass(self) -> str:
        """Unit of a mass, force over acceleration; 1 N s2/mm is 1000 kg."""
        return f"{self.force} s2" if self.dimensionless else f"{self.force} s2/{self.displacement}"

    @property
    def compliance(self) -> str:
        """Unit of displacement over force."""
        return f"{self.displacement}/{self.force}"

    @property
    def force_rate(self) -> str:
        """Unit of a drift of the force."""
        return f"{self.force}/s"

    def of(self, kind: str) -> str:
        """Unit of a kind of constant, any of the properties above or time, fraction, count."""
        fixed = {"time": "s", "fraction": "1", "count": "1"}
        return fixed[kind] if kind in fixed else str(getattr(self, kind))

    @property
    def bonded_default(self) -> bool:
        """Whether the specimen can pull: a pad lies loose, a specimen in strain is glued."""
        return self.dimensionless


PAD = UnitSystem("mm", "N", "displacement", "force")
STRAIN = UnitSystem("1", "kPa", "strain", "stress")


@dataclass(frozen=True)
class Scale:
    """An exact ratio: one of the column's units is up/down of ours.

    Dividing by 1000 rounds once where multiplying by 0.001 would round twice.
    """

    up: int = 1
    down: int = 1

    def convert(self, values: NDArray[np.float64]) -> None:
        """Convert to our unit, in place."""
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
    "rate": {"mm_s": SAME, "1_s": SAME},
}
"""Quantity to the suffixes it may carry, ours first."""


def column_name(quantity: str, suffix: str) -> str:
    """Column name of a quantity in a unit: 'force', 'mN' -> 'force_mN'."""
    return f"{quantity}_{suffix}" if suffix else quantity
