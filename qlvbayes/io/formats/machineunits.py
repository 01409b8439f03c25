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


STANDARD_GRAVITY = 9.80665  # m/s2, exact by definition (CGPM 1901): N in one kgf
_POUND = 4.4482216152605  # N, exact: 0.45359237 kg under standard gravity
_INCH = 25.4  # mm, exact

_SPELLED: dict[str, dict[str, tuple[str, ...]]] = {
    "time": {
        "s": (
            "sec",
            "secs",
            "second",
            "seconds",
            "sek",
            "sekunde",
            "sekunden",
            "seconde",
            "secondes",
            "secondo",
            "secondi",
            "segundo",
            "segundos",
            "hh:mm:ss",
            "h:mm:ss",
            "h:m:s",
            "hms",
        ),
        "ms": ("msec", "millisecond", "milliseconds", "millisekunden", "millisecondes"),
        "min": (
            "mins",
            "minute",
            "minutes",
            "minuten",
            "minuto",
            "minuti",
            "minutos",
        ),
    },
    "displacement": {
        "mm": ("millimeter", "millimetre", "millimeters", "millimetres"),
        "um": ("micron", "microns", "micrometer", "micrometers", "micrometres"),
        "nm": (),
        "m": ("meter", "metre", "meters", "metres"),
    },
    "force": {"N": ("newton", "newtons"), "mN": (), "uN": (), "nN": ()},
    "strain": {"": ("mm/mm", "m/m", "1", "-", "strain")},
    "stress": {"kPa": (), "MPa": ("n/mm2", "n/mm^2"), "Pa": ("n/m2", "n/m^2")},
}
_FURTHER = {
    "h": Unit("time", "s", 3600.0),
    "us": Unit("time", "s", 1e-6),
    "hour": Unit("time", "s", 3600.0),
    "hours": Unit("time", "s", 3600.0),
    "stunden": Unit("time", "s", 3600.0),
    "heures": Unit("time", "s", 3600.0),
    "cm": Unit("displacement", "mm", 10.0),
    "dm": Unit("displacement", "mm", 100.0),
    "in": Unit("displacement", "mm", _INCH),
    "inch": Unit("displacement", "mm", _INCH),
    "inches": Unit("displacement", "mm", _INCH),
    "mil": Unit("displacement", "mm", 1e-3 * _INCH),
    "mils": Unit("displacement", "mm", 1e-3 * _INCH),
    "kN": Unit("force", "N", 1e3),
    "MN": Unit("force", "N", 1e6),
    "cN": Unit("force", "N", 0.01),
    "dN": Unit("force", "N", 0.1),
    "daN": Unit("force", "N", 10.0),
    "pN": Unit("force", "nN", 1e-3),
    "gf": Unit("force", "N", 1e-3 * STANDARD_GRAVITY),
    "g": Unit("force", "N", 1e-3 * STANDARD_GRAVITY),
    "gram": Unit("force", "N", 1e-3 * STANDARD_GRAVITY),
    "grams": Unit("force", "N", 1e-3 * STANDARD_GRAVITY),
    "kgf": Unit("force", "N", STANDARD_GRAVITY),
    "kg": Unit("force", "N", STANDARD_GRAVITY),
    "kp": Unit("force", "N", STANDARD_GRAVITY),
    "lbf": Unit("force", "N", _POUND),
    "lb": Unit("force", "N", _POUND),
    "lbs": Unit("force", "N", _POUND),
    "ozf": Unit("force", "N", _POUND / 16.0),
    "%": Unit("strain", "", 0.01),
    "GPa": Unit("stress", "MPa", 1e3),
    "mPa": Unit("stress", "Pa", 1e-3),
    "psi": Unit("stress", "kPa", 1e-3 * _POUND / (_INCH * 1e-3) ** 2),
}


def _table() -> dict[str, Unit]:
    table = dict(_FURTHER)
    for quantity, units in _SPELLED.items():
        for tidy, others in units.items():
            table |= dict.fromkeys((tidy, *others) if tidy else others, Unit(quantity, tidy))
    return table


_KNOWN = _table()
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


CLOCKS = ("hh:mm:ss", "h:mm:ss", "h:m:s", "hms")
"""Units of time that say how it is written; its values are then in s."""


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


QUANTITIES = (("time",), ("displacement", "strain"), ("force", "stress"))
