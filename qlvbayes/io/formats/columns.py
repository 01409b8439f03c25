"""Which column of a machine's table is which quantity, in the words of several languages."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.formats.format import Channel, Floats, Recording
from qlvbayes.io.formats.machineunits import unit_of

# For each quantity, the more telling words first: the first that any column bears is taken.
_WORDS = {
    "time": (r"(elapsed |running |test |total )?(time|zeit|temps|tiempo|tempo)\b.*", r"prufzeit"),
    "displacement": (
        r"indentation",
        r"(compressive |compression )?(extension|displacement|disp)",
        r"axial (displacement|disp)",
        r"(standardweg|standard travel|course standard|desplazamiento estandar)",
        r"(verformung|deformation)",
        r"tip",
        r"position( z)?",
        r"(traversenweg|crosshead|crosshead travel|course traverse|weg|travel|stroke|depth)",
    ),
    "force": (
        r"(compressive |compression |axial )?(force|load)",
        r"(standardkraft|standard force|force standard|fuerza estandar|kraft)",
        r"f z|fz|f",
    ),
    "strain": (r"(compressive |axial )?(strain|dehnung|stauchung|deformation relative)",),
    "stress": (r"(compressive |axial )?(stress|spannung|druckspannung)",),
}


@dataclass(frozen=True)
class Named:
    """A column's place, its name without the unit, and its unit as written."""

    place: int
    name: str
    unit: str


def split_header(cell: str) -> tuple[str, str]:
    """Name and unit of a cell: 'Force (N)', 'Fz, gf', 'Force_N' or 'Load [kN]'."""
    patterns = (r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]", r"(.*),\s*([^,\s]+)", r"(.+)_([^_\s]+)")
    for pattern in patterns:
        if match := re.fullmatch(pattern, cell.strip()):
            name, unit = match[1].strip(), match[2].strip()
            if any(unit_of(unit, quantity) for quantity in _WORDS):
                return name, unit
    return cell.strip(), ""


def plain_name(name: str) -> str:
    """A name in lower case, without accents and marks: 'Prüfzeit' -> 'prufzeit'."""
    letters = unicodedata.normalize("NFKD", name.lower())
    text = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"[^a-z0-9%]+", " ", text).strip()


def quantities(columns: Sequence[Named]) -> dict[str, Named]:
    """The column of each quantity that is there; the first of those that say it equally."""
    found = {}
    for quantity, patterns in _WORDS.items():
        for pattern in patterns:
            alike = [c for c in columns if re.fullmatch(pattern, plain_name(c.name))]
            fitting = [c for c in alike if not c.unit or unit_of(c.unit, quantity)]
            if fitting:
                found[quantity] = fitting[0]
                break
    return found


def chosen(columns: Sequence[Named], file: Path, line: int | None = None) -> dict[str, Named]:
    """Columns of time, of displacement or strain, and of force or stress.

    Displacement goes before strain and force before stress, but for strain with stress alone.

    Raises
    ------
    InputError
        One of the three is not there.
    """
    found = quantities(columns)
    way = "displacement" if "displacement" in found else "strain"
    load = "force" if "force" in found else "stress"
    missing = [
        words
        for key, words in (("time", "time"), (way, "displacement"), (load, "force"))
        if key not in found
    ]
    if missing:
        shown = ", ".join(column.name for column in columns[:12])[:200]
        raise InputError(
            f"no column for {' and '.join(missing)} (the file has: {shown})",
            file=file,
            line=line,
            remedy="export time, displacement and force of every sample",
        )
    return {"time": found["time"], way: found[way], load: found[load]}


def recording(
    columns: Sequence[Named],
    picked: dict[str, Named],
    values: Sequence[Floats],
    dropped: dict[str, int],
    name: str = "",
    began: float | None = None,
) -> Recording:
    """A recording of the picked columns, their values in the same order."""
    channels = [
        Channel(quantity, column, named.unit, named.name)
        for (quantity, named), column in zip(picked.items(), values, strict=True)
    ]
    taken = {named.place for named in picked.values()}
    unused = tuple(c.name for c in columns if c.place not in taken and c.name)
    time, way, load = channels
    return Recording(time, way, load, name, began, None, dropped, unused)
