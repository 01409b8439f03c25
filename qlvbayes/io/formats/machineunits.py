"""Convert units as machines write them to tidy units."""

from __future__ import annotations

import re
from dataclasses import dataclass

from qlvbayes.io.checks import InputError
from qlvbayes.io.units import SUFFIXES


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
