"""Find which column of a machine's table is which quantity, by names in several languages."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import Channel, Floats, Recording
from qlvbayes.io.formats.machineunits import unit_of

# What may follow a noun: 'force axiale', 'fuerza de compresion', 'corsa della traversa'.
_OF = (
    r"( (axial|axiale|assiale|normal|normale|estandar|standard)"
    r"| (de|di|del|della|en|in|a) (la )?(compression|compresion|compressione|traction|traccion"
    r"|trazione|traverse|traversa|travesano|piston|pistone|verin))?"
)
# For each quantity, the more specific words first: the first that any column bears is taken.
# English, German, French, Italian and Spanish, without accents.
_WORDS = {
    "time": (
        r"(elapsed |running |test |total )?(time|zeit|temps|tiempo|tempo)\b.*",
        r"(pruf|versuchs|test|mess|lauf)zeit|(duree|durata|duracion|dauer)\b.*",
    ),
    "displacement": (
        r"indentation|eindringtiefe|eindruckung|enfoncement|penetration|penetrazione|penetracion",
        r"(compressive |compression |tensile )?(extension|displacement|disp|elongation)",
        r"axial (displacement|disp)|displacement axial",
        r"standard travel|(standard|druck|zug)weg"
        r"|(course|corsa|recorrido|carrera) (standard|estandar)",
        r"(deplacement|desplazamiento|spostamento)" + _OF,
        r"(verlangerung|langenanderung|allongement|allungamento|alargamiento|elongacion"
        r"|elongazione)" + _OF,
        r"(verformung|deformation|deformazione|deformacion|verschiebung|ecrasement"
        r"|schiacciamento|aplastamiento)" + _OF,
        r"tip",
        r"(position|posizione|posicion)( z)?",
        r"(traversen|pruf|verfahr|kolben|axial)?weg|travel|stroke|depth|tiefe|hub",
        r"crosshead|crosshead travel|(course|corsa|recorrido|carrera)" + _OF,
        r"profondeur|profondita|profundidad",
    ),
    "force": (
        r"(compressive |compression |axial |tensile )?(force|load)",
        r"(standard|pruf|druck|zug|axial|normal|mess)?kraft|standard force",
        r"(force|fuerza|forza|effort)" + _OF,
        r"(charge|carga|carico)" + _OF + "|last|belastung",
        r"f z|fz|f",
    ),
    "strain": (
        r"(compressive |axial |tensile |shear )?(strain|dehnung|stauchung)|scherung|scherdehnung",
        r"(deformation|deformazione|deformacion)( (relative|relativa))?" + _OF,
        r"(deformation|deformazione|deformacion) (de|di|a|en) (cisaillement|taglio|cizalla"
        r"|cizallamiento|corte)|taux de deformation",
    ),
    "stress": (
        r"(compressive |axial |tensile |shear )?(stress|spannung)|(druck|zug|schub|scher)spannung",
        r"(contrainte|esfuerzo|tension|tensione|sforzo)" + _OF,
        r"(contrainte|esfuerzo|tension|tensione|sforzo) (de|di|a) (cisaillement|taglio|cizalla"
        r"|cizallamiento|corte)",
    ),
}
_LONGEST = 300  # characters of a name: beyond, a cell is a piece of a file that is no table
_PRESSING = r"(compressive|compression) "  # names of what is positive in compression
# Words of a strain that testing machines also write above a length: the unit decides.
_BY_UNIT = {"displacement": (r"(compressive |axial |tensile )?(strain|dehnung|stauchung)",)}


@dataclass(frozen=True)
class NamedColumn:
    """Column of a table: its index, its name without the unit, and its unit as written."""

    index: int
    name: str
    unit: str


@lru_cache  # each layout asks for the same cells
def split_header(cell: str) -> tuple[str, str]:
    """Return name and unit of a cell: 'Force (N)', 'Fz, gf', 'Force_N' or 'Load [kN]'."""
    if len(cell) > _LONGEST:
        return cell.strip(), ""
    patterns = (r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]", r"(.*),\s*([^,\s]+)", r"(.+)_([^_\s]+)")
    for pattern in patterns:
        if match := re.fullmatch(pattern, cell.strip()):
            name, unit = match[1].strip(), match[2].strip()
            if any(unit_of(unit, quantity) for quantity in _WORDS):
                return name, unit
    return cell.strip(), ""


@lru_cache
def plain_name(name: str) -> str:
    """Return a name in lower case, without accents and marks: 'Prüfzeit' -> 'prufzeit'."""
    letters = unicodedata.normalize("NFKD", name[:_LONGEST].lower())
    text = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"[^a-z0-9%]+", " ", text).strip()


def quantities(columns: Sequence[NamedColumn]) -> dict[str, NamedColumn]:
    """Return the column of each quantity that is there; of equal names the first is taken."""
    by_quantity = {}
    for quantity, patterns in _WORDS.items():
        for pattern in patterns:
            alike = [c for c in columns if re.fullmatch(pattern, plain_name(c.name))]
            fitting = [c for c in alike if not c.unit or unit_of(c.unit, quantity)]
            if fitting:
                by_quantity[quantity] = fitting[0]
                break
    for quantity, patterns in _BY_UNIT.items():
        alike = [c for c in columns for p in patterns if re.fullmatch(p, plain_name(c.name))]
        fitting = [c for c in alike if c.unit and unit_of(c.unit, quantity)]
        if fitting and quantity not in by_quantity:
            by_quantity[quantity] = fitting[0]
    return by_quantity


def measured(columns: Sequence[NamedColumn]) -> dict[str, NamedColumn | None]:
    """Return the columns of time, displacement or strain, and force or stress; None if missing.

    Displacement precedes strain and force precedes stress, except where strain has stress alone.
    """
    by_quantity = quantities(columns)
    way = "displacement" if "displacement" in by_quantity else "strain"
    load = "force" if "force" in by_quantity else "stress"
    return {key: by_quantity.get(key) for key in ("time", way, load)}


def side_by_side(
    columns: Sequence[NamedColumn], picked: dict[str, NamedColumn]
) -> list[dict[str, NamedColumn]]:
    """Return the picked columns of each test: several where their names are repeated in groups.

    The tests may have one column of time together.
    """
    alike = {key: [c for c in columns if c.name == one.name] for key, one in picked.items()}
    clocks, *others = (len(same) for same in alike.values())
    tests = others[0]
    if tests == 1 or set(others) != {tests} or clocks not in (1, tests):
        return [picked]
    return [{key: same[min(k, len(same) - 1)] for key, same in alike.items()} for k in range(tests)]


def titles_of(tests: Sequence[dict[str, NamedColumn]], above: Sequence[str]) -> list[str]:
    """Return a name for each of several tests side by side, from the row above or its number.

    A test alone has no name.
    """
    if len(tests) == 1:
        return [""]
    first = [min(column.index for column in picked.values()) for picked in tests]
    titles = [above[index].strip() if index < len(above) else "" for index in first]
    if all(titles) and len(set(titles)) == len(titles):
        return titles
    return [str(k) for k in range(1, len(tests) + 1)]


def columns_of(columns: Sequence[NamedColumn], picked: dict[str, NamedColumn]) -> list[NamedColumn]:
    """Return the columns without those of other tests side by side."""
    own = {column.index for column in picked.values()}
    names = {column.name for column in picked.values()}
    return [column for column in columns if column.index in own or column.name not in names]


def chosen(
    columns: Sequence[NamedColumn], file: Path, line: int | None = None
) -> dict[str, NamedColumn]:
    """Return the columns that ``measured`` finds.

    Raises
    ------
    InputError
        One of the three is not there.
    """
    by_quantity = measured(columns)
    whole = {key: named for key, named in by_quantity.items() if named is not None}
    words = dict(zip(by_quantity, ("time", "displacement", "force"), strict=True))
    if missing := [words[key] for key in by_quantity if key not in whole]:
        shown = ", ".join(column.name for column in columns[:12])[:200]
        raise InputError(
            f"no column for {' and '.join(missing)} (the file has: {shown})",
            file=file,
            line=line,
            remedy="export time, displacement and force of every sample",
        )
    return whole


def recording(
    columns: Sequence[NamedColumn],
    picked: dict[str, NamedColumn],
    values: Sequence[Floats],
    dropped: dict[str, int],
    name: str = "",
    began: float | None = None,
) -> Recording:
    """Return a recording of the picked columns, their values in the same order."""
    channels = [
        Channel(quantity, column, named.unit, named.name)
        for (quantity, named), column in zip(picked.items(), values, strict=True)
    ]
    taken = {named.index for named in picked.values()}
    unused = tuple(c.name for c in columns if c.index not in taken and c.name)
    time, way, load = channels
    pressing = all(re.match(_PRESSING, plain_name(one.name)) for one in (way, load))
    return Recording(time, way, load, name, began, None, dropped, unused, pressing)
