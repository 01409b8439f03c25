"""Read the header line of a measurement file: each column's quantity and unit."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from qlvbayes.io.checks import InputError
from qlvbayes.io.escaping import as_typed
from qlvbayes.io.units import (
    PAD,
    SAME,
    STRAIN,
    SUFFIXES,
    Scale,
    UnitSystem,
    column_name,
    unit_system,
)

LABELS = ("pad", "fluid", "test", "role", "control", "use", "contact_stage")
_OTHER_NAMES = {"group": "fluid"}
# The longer name first: force_sd_N is not force in 'sd_N'.
_QUANTITIES = sorted(SUFFIXES, key=len, reverse=True)
_MEASURED = ("displacement", "force")
_COUNTERPART = {
    "strain": "displacement",
    "displacement": "strain",
    "stress": "force",
    "force": "stress",
}
_OTHER_WORDS = {
    "time": ("t",),
    "displacement": ("disp", "position", "depth", "indentation", "stroke", "extension"),
    "force": ("load", "f"),
    "strain": ("eps", "epsilon"),
    "stress": ("sigma",),
}
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Column:
    """A column: its index, its name in the file, its unit, and a scale.

    ``scale`` converts to the unit of the displacement column for displacement and rate, to that of
    the force column for force and its sd, and to s for time.
    """

    index: int
    name: str
    suffix: str = ""
    scale: Scale = SAME


@dataclass(frozen=True)
class Columns:
    """Columns that are read; `numeric` are time, displacement, force and force_sd.

    ``force 2`` is a second column of force, in another unit; so is ``displacement 2``.
    """

    units: UnitSystem
    numeric: dict[str, Column]
    labels: dict[str, Column]
    ignored: tuple[str, ...]
    width: int


def read_columns(names: list[str], file: Path, line: int) -> Columns:
    """Return every column with its quantity and unit."""
    header = _Header(names, file, line)
    header.refuse_numbers()
    by_quantity = header.find()
    units = header.choose_units(by_quantity)
    header.refuse_missing(by_quantity, units)
    numeric = {
        "time": by_quantity["time"],
        "displacement": by_quantity[units.displacement_name],
        "force": by_quantity[units.force_name],
    }
    if (measured := f"{units.force_name}_sd") in by_quantity:
        numeric["force_sd"] = by_quantity[measured]
    numeric |= {
        f"{key} 2": by_quantity[f"{key} 2"]
        for key in ("displacement", "force")
        if f"{key} 2" in by_quantity and not units.dimensionless
    }
    labels = {
        key: by_quantity[key]
        for key in (*LABELS, "rate", "start", "contact_sd")
        if key in by_quantity
    }
    own = _Own(numeric["displacement"].scale, numeric["force"].scale)
    numeric, labels = own.scaled(numeric), own.scaled(labels)
    used = {column.index for column in (*numeric.values(), *labels.values())}
    ignored = tuple(name for i, name in enumerate(names) if i not in used and name)
    return Columns(_units_of(units, numeric), numeric, labels, ignored, len(names))


def _units_of(kind: UnitSystem, numeric: dict[str, Column]) -> UnitSystem:
    """Return the units of the file's displacement and force columns."""
    displacement = kind.displacement if kind.dimensionless else numeric["displacement"].suffix
    return unit_system(displacement, numeric["force"].suffix)


@dataclass(frozen=True)
class _Own:
    """Ratios of the file's own units of displacement and force to the default ones."""

    displacement: Scale
    force: Scale

    def scaled(self, columns: dict[str, Column]) -> dict[str, Column]:
        """Return the columns with the ratio of each one's unit to the file's own."""
        own = dict.fromkeys(
            ("displacement", "displacement 2", "rate", "contact_sd"), self.displacement
        )
        own |= dict.fromkeys(("force", "force_sd", "force 2"), self.force)
        return {
            key: replace(column, scale=column.scale.over(own.get(key, SAME)))
            for key, column in columns.items()
        }


def split_name(name: str) -> tuple[str, str] | None:
    """Return quantity and suffix of a column name, or None: 'Force_sd_mN' -> ('force_sd', 'mN')."""
    lower = _OTHER_NAMES.get(name.lower(), name.lower())
    if lower in LABELS or lower == "strain":
        return lower, ""
    for quantity in _QUANTITIES:
        if lower == quantity or lower.startswith(f"{quantity}_"):
            return quantity, re.sub("[µμ]", "u", name[len(quantity) + 1 :])
    return None


def is_tidy_name(name: str) -> bool:
    """Return whether a column is named exactly as in a tidy file: time_s or pad, not Time [s]."""
    parts = split_name(name) if name[:1].islower() else None
    return parts is not None and parts[1] in SUFFIXES.get(parts[0], {"": SAME})


@dataclass(frozen=True)
class _Header:
    names: list[str]
    file: Path
    line: int

    def fail(self, message: str, remedy: str) -> NoReturn:
        raise InputError(message, file=self.file, line=self.line, remedy=remedy)

    def refuse_numbers(self) -> None:
        if sum(bool(_NUMBER.fullmatch(name)) for name in self.names) >= 2:
            self.fail(
                "the first line has numbers, not column names",
                "add a header line such as time_s,displacement_mm,force_N",
            )

    def find(self) -> dict[str, Column]:
        by_quantity: dict[str, Column] = {}
        unknown: list[tuple[str, str, str]] = []
        twins: dict[str, Column] = {}  # of a quantity that stands there in two units
        for index, name in enumerate(self.names):
            if (parts := split_name(name)) is None:
                continue
            quantity, suffix = parts
            scales = SUFFIXES.get(quantity, {"": SAME})
            if suffix not in scales:
                unknown.append((quantity, suffix, name))
                continue
            known = by_quantity.get(quantity)
            second = f"{quantity} 2" not in twins and quantity in _MEASURED
            if known is not None and second and known.suffix != suffix:
                twins[f"{quantity} 2"] = Column(index, name, suffix, scales[suffix])
                continue
            if quantity in by_quantity:
                both = f"'{by_quantity[quantity].name}' and '{name}'"
                self.fail(f"two columns for {quantity}: {both}", "delete one of them")
            by_quantity[quantity] = Column(index, name, suffix, scales[suffix])
        for quantity, suffix, name in unknown:
            self.refuse_unit(quantity, suffix, name, by_quantity)
        return by_quantity | twins

    def refuse_unit(
        self, quantity: str, suffix: str, name: str, by_quantity: dict[str, Column]
    ) -> None:
        """Refuse an unknown unit, unless the quantity has a column: force_raw next to force_N."""
        if quantity in by_quantity or _COUNTERPART.get(quantity) in by_quantity:
            return
        what = f"the unit '{suffix}' of '{name}' is unknown" if suffix else f"'{name}' has no unit"
        self.fail(what, f"rename it to {_spellings(quantity)} and convert its values to that unit")

    def choose_units(self, by_quantity: dict[str, Column]) -> UnitSystem:
        for pad, strain in (("displacement", "strain"), ("force", "stress")):
            if pad in by_quantity and strain in by_quantity:
                both = f"'{by_quantity[pad].name}' and '{by_quantity[strain].name}'"
                self.fail(f"two columns for one quantity: {both}", "delete one of them")
        units = STRAIN if "strain" in by_quantity or "stress" in by_quantity else PAD
        other = PAD if units is STRAIN else STRAIN
        for key in (other.displacement_name, other.force_name, f"{other.force_name}_sd"):
            if key in by_quantity:
                self.fail(
                    f"'{by_quantity[key].name}' does not go with {units.displacement_name} and "
                    f"{units.force_name}",
                    "give displacement with force, or strain with stress",
                )
        strained = units is STRAIN
        if "rate" in by_quantity and (by_quantity["rate"].suffix == "1_s") != strained:
            right = "1_s" if strained else "mm_s"
            self.fail(f"'{by_quantity['rate'].name}' is of the wrong unit", f"give rate_{right}")
        return units

    def refuse_missing(self, by_quantity: dict[str, Column], units: UnitSystem) -> None:
        needed = ("time", units.displacement_name, units.force_name)
        missing = [quantity for quantity in needed if quantity not in by_quantity]
        if not missing:
            return
        remedies = [remedy for quantity in missing if (remedy := self.rename(quantity))]
        if len(self.names) == 1:
            remedies = ["separate the columns by commas"]
        elif len(remedies) < len(missing):
            wanted = ", ".join(_default(quantity) for quantity in missing)
            remedies.append(f"the columns needed are {wanted}")
        if len(self.names) >= len(needed):
            typed = as_typed("qlvbayes", "look", str(self.file))
            remedies.append(f"or name three of them: {typed} --columns T,X,F -o tidy.csv")
        shown = ", ".join(self.names[:12])[:200]
        self.fail(
            f"no column for {' and '.join(missing)} (the file has: {shown})", "; ".join(remedies)
        )

    def rename(self, quantity: str) -> str | None:
        """Return the remedy for a column that means the quantity but is spelled 'Force [N]'."""
        words = (quantity, *_OTHER_WORDS[quantity])
        for name in self.names:
            first, *rest = re.findall(r"[A-Za-zµμ]+|$", name)
            if first.lower() in words:
                units = [re.sub("[µμ]", "u", unit) for unit in rest]
                known = [unit for unit in units if unit and unit in SUFFIXES[quantity]]
                new = column_name(quantity, known[-1]) if known else _spellings(quantity)
                return f"rename '{name}' to {new}"
        return None


def _default(quantity: str) -> str:
    return column_name(quantity, next(iter(SUFFIXES[quantity])))


def _spellings(quantity: str) -> str:
    names = [column_name(quantity, suffix) for suffix in SUFFIXES[quantity]]
    return " or ".join(names)
