"""Find which column of a table is which quantity: names in several languages, and tidy names."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.recording import Channel, Recording, UnsureError
from qlvbayes.io.units import CLOCKS, QUANTITIES, SAME, SUFFIXES, unit_of
from qlvbayes.io.wording import joined

# Words that may follow a noun: 'force axiale', 'fuerza de compresion', 'corsa della traversa'.
_OF = (
    r"( (axial|axiale|assiale|normal|normale|estandar|standard)"
    r"|( (de|di|del|della|en|in|a))? (la )?(compression|compresion|compressione|traction|traccion"
    r"|trazione|traverse|traversa|travesano|piston|pistone|verin))?"
)
_GAP = (
    r"(measuring |mess ?)?(gap|spalt)( (width|height|size))?|(mess)?spalt(weite|hohe|breite)"
    r"|entrefer|traferro|entrehierro"
)
# For each quantity, the more specific words first: the first that any column bears is taken.
# English, German, French, Italian and Spanish, without accents.
_WORDS = {
    "time": (
        r"(?!(time|uhrzeit|heure|hora|ora) (of day|du jour|del dia)|(clock|day|date|step) ?time)"
        r"(elapsed |running |test |total )?(time|zeit|temps|tiempo|tempo)\b.*",
        r"step ?time|schrittzeit|(abschnitts|intervall)zeit",
        r"(elapsed |running |test |total )?(time|zeit|temps|tiempo|tempo)\b.*",
        r"(pruf|versuchs|test|mess|lauf)zeit|(duree|durata|duracion|dauer)\b.*",
        r"time ?stamp|date ?time|zeitstempel|horodatage",
        r"clock( time)?|uhrzeit|heure|hora|ora|orario",
    ),
    "displacement": (
        r"(indentation|penetration)( depth)?|pd|eindringtiefe|eindruckung|enfoncement|penetrazione"
        r"|penetracion",
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
        _GAP,
    ),
    "force": (
        r"(compressive |compression |axial |tensile )?(force|load)",
        r"(standard|pruf|druck|zug|axial|mess)?kraft|standard force",
        r"(force|fuerza|forza|effort)" + _OF,
        r"(charge|carga|carico)" + _OF + "|last|belastung",
        r"f z|fz|fn|f",
        r"normal ?force|normalkraft",  # of a rheometer, next to the shear force
    ),
    "strain": (
        r"(compressive |axial |tensile |shear )?(strain|dehnung|stauchung)|scherung|scherdehnung"
        r"|scher(deformation|verformung)",
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
_ASKED = {"time": "s", "displacement": "mm", "force": "N"}
"""What a test consists of, each with the unit in which it is stated by default."""
_CHANNEL = re.compile(r"^(c|ch|channel|kanal|voie|canal) ?\d+ (?=\D)")
_BRACKETED = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]\s*")
_WITH_UNIT = (
    r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]",
    r"(.*),\s*([^,\s]+)",
    r"(.+)_([^_\s]+)",
    r"(.+)_([^_\s]+)_",  # MATLAB's writetable makes Force_N_ of Force (N)
    r"(.+?)\s*/\s*([^/\s]+)",  # ISO 80000-1: a quantity over its unit
    r"(.+)\s+in\s+(\S+)",
)
"""Ways to write a column's unit after its name."""
_LOGARITHM = re.compile(r"(log10|log|lg|ln)\s*\(\s*(.+?)\)", re.IGNORECASE)
_BASES = {"ln": math.e}  # of logarithms, 10 of all others
_COPY = re.compile(r"\.\d+$")  # by which pandas numbers equal names
_EITHER = re.compile(r"[^A-Z]MN[)\]_]?$")
_TIMES_TEN = re.compile(r"[x×*] ?\d")  # Force x10: its values are not in its unit
_LONGEST = 300  # characters of a name: beyond, a cell is a piece of a file that is no table
_SHEAR = re.compile(r"\b(shear|scher\w*|schub\w*|cisaillement|taglio|cizalla\w*|corte)\b")
"""Names of what has no side that presses: its signs are kept."""
_PRESSING = r"(compressive|compression) "  # names of what is positive in compression
# Words of a strain that testing machines also write above a length: the unit decides.
_BY_UNIT = {"displacement": (r"(compressive |axial |tensile )?(strain|dehnung|stauchung)",)}


LABELS = ("pad", "fluid", "test", "role", "control", "use", "contact_stage")
"""Columns of text in a tidy file."""
_TIDY = sorted(SUFFIXES, key=len, reverse=True)  # force_sd_N is not force in 'sd_N'


@dataclass(frozen=True)
class NamedColumn:
    """Column of a table: its index, its name without the unit, and its unit as written."""

    index: int
    name: str
    unit: str

    @property
    def written(self) -> str:
        """Return the name with its unit, or the number from 1 of a column without a name."""
        name = self.name or str(self.index + 1)
        return f"{name} ({self.unit})" if self.unit else name


@lru_cache  # each layout asks for the same cells
def split_header(cell: str) -> tuple[str, str]:
    """Return name and unit of a cell: 'Force (N)', 'Fz, gf', 'Weg / mm' or 'Zeit in s'.

    Of the logarithm of a quantity over its unit, as 'log10(t/s)', they are 'log10 t' and 's'.
    """
    if len(cell) <= _LONGEST and (of := _LOGARITHM.fullmatch(cell.strip())):
        name, unit = split_header(of[2])
        if unit:  # in 'Ln (mm)' the unit of a length stands in brackets
            return f"{of[1].lower()} {name}", unit
    if len(cell) > _LONGEST or (cell.isupper() and _EITHER.search(cell)):
        return cell.strip(), ""
    for pattern in _WITH_UNIT:
        if match := re.fullmatch(pattern, cell.strip()):
            name, unit = match[1].strip(), match[2].strip()
            if _is_unit(unit) and not ("/" in pattern and _is_unit(name.rpartition(" ")[2])):
                return name, unit
    return cell.strip(), ""


def in_cells(cells: Sequence[str]) -> list[NamedColumn]:
    """Return columns whose units follow their names, in one row."""
    names = [_COPY.sub("", cell) for cell in cells]
    plain = [name if name in cells else cell for name, cell in zip(names, cells, strict=True)]
    return [NamedColumn(index, *split_header(cell)) for index, cell in enumerate(plain)]


def in_two_rows(names: Sequence[str], units: Sequence[str]) -> list[NamedColumn]:
    """Return columns whose units are in the row below their names, or above them."""
    padded = [*units, *[""] * len(names)]
    return [
        NamedColumn(index, name, padded[index].strip(" ()[]'\"").removeprefix("in "))
        for index, name in enumerate(names)
    ]


def _is_unit(text: str) -> bool:
    return any(unit_of(text, quantity) for quantity in _WORDS)


@lru_cache
def plain_name(name: str) -> str:
    """Return a name in lower case, without accents and marks: 'Prüfzeit' -> 'prufzeit'."""
    letters = unicodedata.normalize("NFKD", name[:_LONGEST].lower())
    text = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"[^a-z0-9%]+", " ", text).strip()


_MEAN = re.compile(
    r"\b(mean|average|mittelwert\w*|mittlere?|durchschnitt\w*|moyenn?e?|media|medio|promedio)\b"
)
_CONDITION = re.compile(
    r"\b(speeds?|velocit\w+|rates?|vitesses?|velocidad\w*|geschwindigkeit\w*|tempo|strain|load|force"
    r"|depth|temperature\w*|pressure|compression|compresion\w*)\b"
)


def is_mean(name: str) -> bool:
    """Return whether a name is that of the mean specimen, no test: 'Eprouvette moyenne'."""
    plain = plain_name(name)
    return _MEAN.search(plain) is not None and _CONDITION.search(plain) is None


def quantities(columns: Sequence[NamedColumn]) -> dict[str, NamedColumn]:
    """Return the column of each quantity that is there; of equal names the first is taken."""
    # without the channel before it: 'C_1_Force' or 'Ch 1 Force' is a force
    plain = [(column, _CHANNEL.sub("", plain_name(column.name))) for column in columns]
    by_quantity = {}
    for quantity, patterns in _WORDS.items():
        for pattern in (*patterns, *(by_unit := _BY_UNIT.get(quantity, ()))):
            alike = (column for column, name in plain if re.fullmatch(pattern, name))
            fitting = (
                column
                for column in alike
                if (unit_of(column.unit, quantity) if column.unit else pattern not in by_unit)
            )
            if (first := next(fitting, None)) is not None:
                by_quantity[quantity] = first
                break
    return by_quantity


def measured(columns: Sequence[NamedColumn]) -> dict[str, NamedColumn | None]:
    """Return the columns of time, displacement or strain, and force or stress; None if missing."""
    by_quantity = quantities(columns)
    for either in QUANTITIES:
        if not set(either) & set(by_quantity):
            by_quantity |= _by_unit(columns, either) or _with_unknown_unit(columns, either)
    sheared = {"strain", "stress"} <= set(by_quantity)
    way = "displacement" if "displacement" in by_quantity else "strain"
    load = "force" if "force" in by_quantity else "stress"
    if (way, load) != ("displacement", "force") and sheared:
        way, load = "strain", "stress"
    return {key: by_quantity.get(key) for key in ("time", way, load)}


def sheared_instead(
    columns: Sequence[NamedColumn], picked: dict[str, NamedColumn]
) -> dict[str, NamedColumn] | None:
    """Return time, strain and stress where a rheometer's gap was picked and these are there too."""
    found, way = quantities(columns), picked.get("displacement")
    there = {"strain", "stress"} <= set(found)
    if way is None or not there or not re.fullmatch(_GAP, plain_name(way.name)):
        return None
    return {key: found[key] for key in ("time", "strain", "stress")}


def _by_unit(columns: Sequence[NamedColumn], either: Sequence[str]) -> dict[str, NamedColumn]:
    """Return the only column with a unit of one of the quantities; empty where there are more."""
    kinds = [quantity for quantity in either if quantity != "strain"]
    named = [c for c in columns if c.name and c.unit and not _TIMES_TEN.search(c.name)]
    alike = [(kind, column) for kind in kinds for column in named if unit_of(column.unit, kind)]
    return dict(alike) if len(alike) == 1 else {}


def _with_unknown_unit(
    columns: Sequence[NamedColumn], either: Sequence[str]
) -> dict[str, NamedColumn]:
    """Return the first column that is named so, in whatever unit, which has to be asked for."""
    for column in columns:
        match = None if column.unit else _BRACKETED.fullmatch(column.name)
        name, unit = match.groups() if match else (column.name, column.unit)
        for kind in () if _is_unit(unit) else either:
            if any(re.fullmatch(word, _CHANNEL.sub("", plain_name(name))) for word in _WORDS[kind]):
                return {kind: NamedColumn(column.index, name, unit)}
    return {}


def side_by_side(
    columns: Sequence[NamedColumn], picked: dict[str, NamedColumn]
) -> list[dict[str, NamedColumn]]:
    """Return the picked columns of each test: several where their names are repeated in groups."""
    alike = {key: [c for c in columns if c.name == one.name] for key, one in picked.items()}
    clocks, *others = (len(same) for same in alike.values())
    tests = others[0]
    if tests == 1 or set(others) != {tests} or clocks not in (1, tests):
        return [picked]
    return [{key: same[min(k, len(same) - 1)] for key, same in alike.items()} for k in range(tests)]


def unsure_of_columns(columns: Sequence[NamedColumn], file: Path) -> InputError:
    """Return the question which columns are those of time, displacement and force.

    It says what none of them shows, and how to state it where a column may hold it.
    """
    shown = f" (the file has: {', '.join(column.written for column in columns)[:200]})"
    found = dict(zip(_ASKED, measured(columns).values(), strict=True))
    missing = [word for word, column in found.items() if column is None]
    taken = {column.index for column in found.values() if column is not None}
    for word, either in zip(_ASKED, QUANTITIES, strict=True):
        fits = (
            column
            for column in columns
            if column.index not in taken
            and (any(unit_of(column.unit, kind) for kind in either) or not _is_unit(column.unit))
        )
        if found[word] is None and (first := next(fits, None)) is not None:
            found[word] = first
            taken.add(first.index)
    if nowhere := [word for word, column in found.items() if column is None]:
        what = f"no column for {' and '.join(nowhere)}"
        remedy = f"export it with the {' and the '.join(nowhere)}"
        return InputError(what + shown, file=file, remedy=remedy)
    numbers = {word: column.index + 1 for word, column in found.items() if column is not None}
    units = [
        column.unit if column is not None and _is_unit(column.unit) else unit
        for column, unit in zip(found.values(), _ASKED.values(), strict=True)
    ]
    said = joined([f"column {numbers[word]} is the {word}" for word in missing])
    which = "columns are" if len(missing) > 1 else "column is the"
    return UnsureError(
        f"the names and units do not show which {which} {joined(missing)}{shown}",
        file=file,
        option="columns",
        question=f"columns of time, displacement and force, by name or number, as 1,2,3{shown}",
        say=f"{','.join(map(str, numbers.values()))} --units {','.join(units)}, if {said}",
    )


def chosen(
    columns: Sequence[NamedColumn], file: Path, line: int | None = None
) -> dict[str, NamedColumn]:
    """Return the columns that ``measured`` finds."""
    by_quantity = measured(columns)
    whole = {key: named for key, named in by_quantity.items() if named is not None}
    words = dict(zip(by_quantity, _ASKED, strict=True))
    if missing := [words[key] for key in by_quantity if key not in whole]:
        shown = ", ".join(column.name for column in columns[:12])[:200]
        raise InputError(
            f"no column for {' and '.join(missing)} (the file has: {shown})",
            file=file,
            line=line,
            remedy="export time, displacement and force of every sample",
        )
    return whole


def on_clock(
    picked: dict[str, NamedColumn], clocks: Container[int], file: Path
) -> dict[str, NamedColumn]:
    """Return the columns with the unit s for a time written as hh:mm:ss, whose values are in s."""
    written = next(iter(picked)) == "time" and 0 in clocks
    unit = re.sub(r"[.,]\w+$", "", picked["time"].unit.lower())
    if written:
        return picked | {"time": replace(picked["time"], unit="s")}
    if unit in CLOCKS:
        raise InputError(
            f"the unit of {picked['time'].name} is {unit}, and its values are plain numbers",
            file=file,
            remedy="export time in s",
        )
    return picked


def recording(
    columns: Sequence[NamedColumn],
    picked: dict[str, NamedColumn],
    values: Sequence[Floats],
    dropped: dict[str, int],
    name: str = "",
) -> Recording:
    """Return a recording of the picked columns, their values in the same order."""
    channels = []
    for (quantity, named), column in zip(picked.items(), values, strict=True):
        word, _, of = named.name.partition(" ")
        if of and _LOGARITHM.fullmatch(f"{word}({of})"):  # the column has logarithms
            column = np.asarray(_BASES.get(word, 10.0) ** column)
        channels.append(Channel(quantity, column, named.unit, named.name))
    taken = {named.name for named in picked.values()}
    unused = tuple(c.name for c in columns if c.name and c.name not in taken)
    time, way, load = channels
    pressing = all(re.match(_PRESSING, plain_name(one.name)) for one in (way, load)) or any(
        _SHEAR.search(plain_name(one.name)) for one in (way, load)
    )
    return Recording(time, way, load, name, dropped=dropped, unused=unused, pressing=pressing)


def split_name(name: str) -> tuple[str, str] | None:
    """Return quantity and suffix of a tidy name, or None: 'Force_sd_mN' -> ('force_sd', 'mN')."""
    lower = "fluid" if name.lower() == "group" else name.lower()
    if lower in LABELS or lower == "strain":
        return lower, ""
    for quantity in _TIDY:
        if lower == quantity or lower.startswith(f"{quantity}_"):
            return quantity, re.sub("[µμ]", "u", name[len(quantity) + 1 :])
    return None


def is_tidy_name(name: str) -> bool:
    """Return whether a column is named exactly as in a tidy file: time_s or pad, not Time [s]."""
    parts = split_name(name) if name[:1].islower() else None
    return parts is not None and parts[1] in SUFFIXES.get(parts[0], {"": SAME})
