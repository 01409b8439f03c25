"""Define systems of units, the suffixes of column names, and units as machines write them.

Displacement and force stay in the units of the file; time is in s.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError

_KINDS: dict[str, tuple[str, str, tuple[int, int] | None]] = {
    "displacement": ("{d}", "{d}", (1, 0)),
    "force": ("{f}", "{f}", (0, 1)),
    "stiffness": ("{f}/{d}", "{f}", (-1, 1)),  # of m, in K = m exp(b d)
    "power_stiffness": ("{f}/{d}^n", "{f}", None),
    "quadratic_stiffness": ("{f}/{d}2", "{f}", (-2, 1)),
    "cubic_stiffness": ("{f}/{d}3", "{f}", (-3, 1)),
    "exponent": ("1/{d}", "1", (-1, 0)),  # of b
    "rate": ("1/s", "1/s", (0, 0)),  # of the relaxation rates v_i
    "speed": ("{d}/s", "{d}/s", (1, 0)),
    "drag": ("{f} s/{d}", "{f} s", (-1, 1)),
    "power_drag": ("{f} (s/{d})^n", "{f} s^n", None),
    "mass": ("{f} s2/{d}", "{f} s2", (-1, 1)),  # 1 N s2/mm is 1000 kg
    "compliance": ("{d}/{f}", "{d}/{f}", (1, -1)),
    "force_rate": ("{f}/s", "{f}/s", (0, 1)),
    "time": ("s", "s", (0, 0)),
    "fraction": ("1", "1", (0, 0)),
    "count": ("1", "1", (0, 0)),
}
"""Units of each kind of constant, with displacement and force, and with strain and stress; the
powers of displacement and of force in it, None where they depend on an exponent."""


@dataclass(frozen=True)
class UnitSystem:
    """Units of displacement and force, from which all other units follow; time is in s."""

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
        return self.of("stiffness")

    @property
    def speed(self) -> str:
        """Return the unit of the loading rate."""
        return self.of("speed")

    def of(self, kind: str) -> str:
        """Return the unit of a kind of constant; raise KeyError where there is no such kind."""
        unit, of_strain, _ = _KINDS[kind]
        text = of_strain if self.dimensionless else unit
        return text.format(d=self.displacement, f=self.force)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of constants that have units."""
        return tuple(_KINDS)

    def knows(self, kind: str) -> bool:
        """Return whether there is such a kind of constant."""
        return kind in _KINDS

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
        powers = _KINDS[kind][2]
        if powers is None:
            raise KeyError(kind)
        length, force = powers
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
class UnitRatio:
    """Exact ratio of two units: one of the column's units is up/down of another one."""

    up: int = 1
    down: int = 1

    def over(self, other: UnitRatio) -> UnitRatio:
        """Return the ratio of two ratios, in lowest terms."""
        up, down = self.up * other.down, self.down * other.up
        common = math.gcd(up, down)
        return UnitRatio(up // common, down // common)

    def convert(self, values: NDArray[np.float64]) -> None:
        """Convert the values in place."""
        if self.up != 1:
            values *= self.up
        if self.down != 1:
            values /= self.down


SAME = UnitRatio()


def _scales(first: str, *others: str) -> dict[str, UnitRatio]:
    """Return the ratio of each unit to the first one."""
    decades = {unit: _decades(unit, first) for unit in (first, *others)}
    return {unit: UnitRatio(10 ** max(n, 0), 10 ** max(-n, 0)) for unit, n in decades.items()}


_TIME = {"s": SAME, "ms": UnitRatio(down=1000), "min": UnitRatio(up=60)}
_LENGTH = _scales("mm", "um", "nm", "m")
_FORCE = _scales("N", "mN", "uN", "nN")
_STRESS = _scales("kPa", "MPa", "Pa")

SUFFIXES: dict[str, dict[str, UnitRatio]] = {
    "time": _TIME,
    "displacement": _LENGTH,
    "force": _FORCE,
    "force_sd": _FORCE,
    "strain": {"": SAME},
    "stress": _STRESS,
    "stress_sd": _STRESS,
    "start": _TIME,
    "contact_sd": _LENGTH,
    "tare_sd": _FORCE,
    "rate": {**{f"{unit}_s": scale for unit, scale in _LENGTH.items()}, "1_s": SAME},
}
"""Suffixes of each quantity, the default one first, each with its ratio to the default."""


def column_name(quantity: str, suffix: str) -> str:
    """Return the column name of a quantity in a unit: 'force', 'mN' -> 'force_mN'."""
    return f"{quantity}_{suffix}" if suffix else quantity


# Units as machines write them


@dataclass(frozen=True)
class Unit:
    """Unit of a quantity, the tidy unit that it is converted to, and the factor."""

    quantity: str
    tidy: str
    factor: float = 1.0


QUANTITIES = (("time",), ("displacement", "strain"), ("force", "stress"))
CLOCKS = ("hh:mm:ss", "h:mm:ss", "h:m:s", "hms")
"""Units of time that say how it is written; its values are then in s."""
STANDARD_GRAVITY = 9.80665  # m/s2, exact by definition (CGPM 1901): N in one kgf
_POUND = 4.4482216152605  # N, exact: 0.45359237 kg under standard gravity
_INCH = 25.4  # mm, exact
_UNITS = (
    ("time", "s", 1.0, "s sec secs second seconds sek sekunde sekunden seconde secondes secondo"
     " secondi segundo segundos " + " ".join(CLOCKS)),
    ("time", "ms", 1.0, "ms msec millisecond milliseconds millisekunden millisecondes"),
    ("time", "min", 1.0, "min mins minute minutes minuten minuto minuti minutos"),
    ("time", "s", 3600.0, "h hour hours stunden heures"),
    ("time", "s", 1e-6, "us"),
    ("displacement", "mm", 1.0, "mm millimeter millimetre millimeters millimetres"),
    ("displacement", "um", 1.0, "um micron microns micrometer micrometers micrometres"),
    ("displacement", "nm", 1.0, "nm nanometer nanometers nanometres"),
    ("displacement", "m", 1.0, "m meter metre meters metres"),
    ("displacement", "mm", 10.0, "cm"),
    ("displacement", "mm", 100.0, "dm"),
    ("displacement", "mm", _INCH, "in inch inches"),
    ("displacement", "mm", 1e-3 * _INCH, "mil mils"),
    ("force", "N", 1.0, "N newton newtons"),
    ("force", "mN", 1.0, "mN millinewton millinewtons"),
    ("force", "uN", 1.0, "uN"),
    ("force", "nN", 1.0, "nN"),
    ("force", "N", 1e3, "kN kilonewton kilonewtons"),
    ("force", "N", 1e6, "MN"),
    ("force", "N", 0.01, "cN"),
    ("force", "N", 0.1, "dN"),
    ("force", "N", 10.0, "daN"),
    ("force", "nN", 1e-3, "pN"),
    ("force", "N", 1e-3 * STANDARD_GRAVITY, "gf g gram grams"),
    ("force", "N", STANDARD_GRAVITY, "kgf kg kp"),
    ("force", "N", _POUND, "lbf lb lbs"),
    ("force", "N", _POUND / 16.0, "ozf"),
    ("strain", "", 1.0, "mm/mm m/m 1 - strain"),
    ("strain", "", 0.01, "%"),
    ("stress", "kPa", 1.0, "kPa"),
    ("stress", "MPa", 1.0, "MPa n/mm2 n/mm^2"),
    ("stress", "Pa", 1.0, "Pa n/m2 n/m^2"),
    ("stress", "MPa", 1e3, "GPa"),
    ("stress", "Pa", 1e-3, "mPa"),
    ("stress", "kPa", 1e-3 * _POUND / (_INCH * 1e-3) ** 2, "psi"),
)  # fmt: skip
_KNOWN = {
    name: Unit(quantity, tidy, factor)
    for quantity, tidy, factor, names in _UNITS
    for name in names.split()
}
_PREFIXED = {"mm", "ms", "mN", "MN", "mPa", "MPa"}  # m is a thousandth and M a million
_BY_LOWER: dict[str, list[str]] = {}
for _name in _KNOWN:
    _BY_LOWER.setdefault(_name.lower(), []).append(_name)


def unit_of(text: str, quantity: str) -> Unit | None:
    """Return the unit that a text means for a quantity, or None: '(µN)' is uN for a force."""
    plain = re.sub("[µμ]", "u", text.strip(" ()[]'\".")).replace("²", "2")
    if ":" in plain:
        plain = re.sub(r"[.,]\w+$", "", plain)  # hh:mm:ss.fff
    exact = _KNOWN.get(plain)
    if exact is not None and exact.quantity == quantity:
        return exact
    alike = [name for name in _BY_LOWER.get(plain.lower(), ()) if _may_mean(plain, name)]
    meant = {unit for name in alike if (unit := _KNOWN[name]).quantity == quantity}
    return meant.pop() if len(meant) == 1 else None


def _may_mean(written: str, name: str) -> bool:
    """Return whether a text that differs from a unit in capitals may stand for it."""
    if name not in _PREFIXED or not (written.isupper() or written.islower()):
        return name not in _PREFIXED or written[:1] == name[:1]
    several = len(_BY_LOWER[name.lower()]) > 1
    return not several or (written.isupper() and written[:1] == name[:1])


def named_units(text: str) -> tuple[str, str, str]:
    """Return ``s,mm,N`` as units of time, displacement (or strain) and force (or stress)."""
    parts = [part.strip() for part in text.split(",")]
    remedy = "write for example s,mm,N or s,%,kPa: of time, displacement or strain, force or stress"
    if len(parts) != 3:
        raise InputError(f"--units {text!r} are not three units", remedy=remedy)
    for part, quantities in zip(parts, QUANTITIES, strict=True):
        if all(unit_of(part, quantity) is None for quantity in quantities):
            known = ", ".join(SUFFIXES[quantities[0]])
            raise InputError(
                f"--units: {part!r} is no unit of {' or '.join(quantities)}",
                remedy=f"{remedy}; known are {known} and others",
            )
    return parts[0], parts[1], parts[2]
