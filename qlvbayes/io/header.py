"""Find where a table of text begins, what its columns are, and what the lines above it state."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import (
    LABELS,
    NamedColumn,
    in_cells,
    in_two_rows,
    is_tidy_name,
    measured,
    plain_name,
    split_header,
)
from qlvbayes.io.recording import Stated
from qlvbayes.io.table import are_numbers
from qlvbayes.io.text import COMMENT, Lines, cells_of, hour_of_day, is_like_number, separator_of
from qlvbayes.io.units import QUANTITIES, unit_of
from qlvbayes.io.wording import joined

NAMES = 3  # of time, displacement and force
_BLANK = 2  # most empty rows between the names and their units
_QUANTITIES = ("time", "displacement", "force")
_CLOCK = r"(t|time|clock|timestamp|zeit)( .*)?|.* (t|time|clock|timestamp)"
_OF_LOAD = r"(.* )?(force|load|f|fz|cell|loadcell|stress|kraft)( .*)?"
_OF_WAY = (
    r"(.* )?(disp|displacement|d|position|pos|encoder|stage|platen|strain|extension|weg|x|z)( .*)?"
)


@dataclass(frozen=True)
class Header:
    """Where a table begins: the lines of its names and of its first row (from 0), its columns.

    ``line`` is ``first`` where there are no names. ``picked`` are the columns of time, displacement
    (strain) and force (stress) where they are known already, and ``clock`` is the force's own.
    """

    line: int
    first: int
    columns: Sequence[NamedColumn]
    picked: dict[str, NamedColumn] | None = None
    clock: NamedColumn | None = None


def find_header(lines: Lines, blanks: bool = False, *, tidy: bool = False) -> Header | None:
    """Return the first row that names time, displacement and force, with units or numbers below.

    The names of a tidy file count where ``tidy`` is true. Units are in the row of names, in that
    below or in that above. ``blanks`` is whether blanks separate the cells.
    """
    rows = [cells for _, cells in lines.cells()]
    named: Header | None = None  # as a sentence about the columns may, where names follow
    for number, names in enumerate(rows):
        if sum(bool(cell) and not is_like_number(cell) for cell in names) < NAMES:
            if named and len(names) >= NAMES and are_numbers(names, range(NAMES)):
                break
            continue
        if not tidy and any(name in LABELS if blanks else is_tidy_name(name) for name in names):
            continue
        in_row = in_cells(names)
        nearest = range(number + 1, min(number + 2 + _BLANK, len(rows)))
        below = next((k for k in nearest if any(rows[k])), None)
        by_quantity = measured(in_row).values()
        used = [column.index for column in by_quantity if column] or [0]
        numbers = below is not None and are_numbers(rows[below], used)
        if _have_units(in_row):
            found = _shifted(Header(number, number + 1, in_row), lines)
            if numbers or found.columns[0].index:
                return found
            named = named or found
            continue
        if below is None:
            continue
        if numbers:
            above = in_two_rows(names, rows[number - 1]) if number else []
            if above and are_units(rows[number - 1]) and _have_units(above):
                return Header(number, number + 1, above)
            if all(by_quantity):
                return _shifted(Header(number, number + 1, in_row), lines)
        units = cells_of(lines.texts[below], separator_of(lines.texts[number]))
        if _have_units(columns := in_two_rows(names, units)):
            return Header(number, below + 1, columns)
    return named


def _have_units(columns: Sequence[NamedColumn]) -> bool:
    """Return whether time, displacement and force are among columns, each with a unit."""
    return all(named and named.unit for named in measured(columns).values())


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a row holds units, one of them of time and one of force or stress."""
    kinds = ("time", "force", "stress")
    there = {kind for kind in kinds for cell in cells if cell.strip() and unit_of(cell, kind)}
    return "time" in there and len(there) > 1


def _shifted(header: Header, lines: Lines) -> Header:
    """Return the header of rows that begin with their own name, which the names do not count."""
    separator = separator_of(lines.texts[header.line])
    rows = [cells_of(text, separator) for text in lines.texts[header.first :][:2] if text.strip()]
    labels = [row[0] for row in rows if len(row) == len(header.columns) + 1]
    counted = labels in (["1", "2"], ["0", "1"]) or not any(map(is_like_number, labels))
    if len(labels) < 2 or not counted or not all(map(is_like_number, rows[0][1:])):
        return header
    columns = [replace(column, index=column.index + 1) for column in header.columns]
    return replace(header, columns=columns)


def columns_in(lines: Lines) -> list[NamedColumn]:
    """Return the columns of the first table; empty where there is none, of two or more."""
    for number, cells in lines.cells():
        if len(cells) > 1 and are_numbers(cells, range(min(len(cells), NAMES))):
            named, columns = _columns_above(lines, number, len(cells))
            return columns if named or len(cells) >= NAMES else []
    return []


def _columns_above(
    lines: Lines, first: int, width: int
) -> tuple[list[list[str]], list[NamedColumn]]:
    """Return the row of names, and that of units, directly above numbers, and their columns."""
    separator = separator_of(lines.texts[first])
    above = [cells_of(text, separator) for text in lines.texts[max(first - 2, 0) : first]]
    rows = [row for row in above if width <= len(row) <= width + 1]
    rows = [row for row in rows if not any(map(is_like_number, row))]
    kinds = [kind for either in QUANTITIES for kind in either]
    if not any(unit_of(cell, kind) for row in rows[-1:] for cell in row for kind in kinds):
        rows = rows[-1:]
    if not rows:
        return rows, [NamedColumn(k, f"column {k + 1}", "") for k in range(width)]
    return rows, in_two_rows(*rows) if len(rows) > 1 else in_cells(rows[0])


# Columns that the user states


def named_columns(text: str) -> tuple[str, str, str]:
    """Return ``t,x,F`` as the columns of time, displacement (or strain) and force (or stress)."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != NAMES or len({*parts, ""}) != NAMES + 1:
        raise InputError(
            f"--columns {text[:200]!r} are not three different columns",
            remedy="write the names of time, displacement and force as t,x,F, or their numbers "
            "from 1 as 1,2,3",
        )
    return parts[0], parts[1], parts[2]


def stated_header(lines: Lines, stated: Sequence[str], file: Path) -> Header:
    """Return the header of the table that has the stated columns; an InputError says what lacks."""
    for first, cells in lines.cells():
        named, columns = _columns_above(lines, first, len(cells))
        written = named[0] if named else [""] * len(cells)
        indices = [k for name in stated for k in _stated(name, written, columns)]
        if len(indices) == NAMES and are_numbers(cells, indices):
            picked = {key: columns[k] for key, k in zip(_QUANTITIES, indices, strict=True)}
            return Header(first - len(named), first, columns, picked)
    widest = max((cells for _, cells in lines.cells()), key=len, default=[])
    shown = f" (the file has: {', '.join(widest)[:200]})" if len(widest) > 1 else ""
    raise InputError(
        f"the columns {joined(list(stated))} are not there{shown}",
        file=file,
        remedy="write them as the file does, or their numbers from 1, as --columns 1,2,3",
    )


def _stated(name: str, written: Sequence[str], columns: Sequence[NamedColumn]) -> list[int]:
    """Return the index of a stated column: by its name, with or without its unit, or number."""
    words = [
        (k, (cell, one.name)) for k, (cell, one) in enumerate(zip(written, columns, strict=False))
    ]
    exact = [k for k, own in words if name in own][:1]
    alike = exact or [k for k, own in words if plain_name(name) in map(plain_name, own)]
    if not alike and name.isdecimal() and 0 < int(name) <= len(columns):
        return [int(name) - 1]
    return alike if len(alike) == 1 else []


# Two clocks


def two_clock_header(lines: Lines, blanks: bool = False) -> Header | None:
    """Return a header with a clock for each channel, of which the names say which is whose.

    It is the first line that is no comment.
    """
    texts = enumerate(lines.texts)
    number = next((n for n, text in texts if text.strip() and not COMMENT.match(text)), None)
    if number is None:
        return None
    columns = in_cells(cells_of(lines.texts[number], separator_of(lines.texts[number])))
    clocks = [column for column in columns if re.fullmatch(_CLOCK, plain_name(column.name))]
    by_quantity = measured([c for c in columns if c not in clocks])
    by_quantity.pop("time")
    if len(clocks) != 2 or not all(by_quantity.values()):
        return None
    named = [plain_name(clock.name) for clock in clocks]
    of_load = [bool(re.fullmatch(_OF_LOAD, name)) for name in named]
    of_way = [bool(re.fullmatch(_OF_WAY, name)) for name in named]
    if all(of_load) or all(of_way) or of_load == of_way:
        return None
    way, load = clocks if of_load[1] or of_way[0] else clocks[::-1]
    picked = {"time": way, **{key: one for key, one in by_quantity.items() if one}}
    return Header(number, number + 1, columns, picked, load)


# Statements above a table

# Keys without accents and marks, in English, German, French, Italian and Spanish.
_SPECIMEN = (
    r"(specimen|sample|prufling|eprouvette|echantillon|probeta|muestra|provino|campione|pad)"
    r"( ?(id|name|label|code|bezeichnung|kennung))?|proben?( ?(id|name|code|bezeichnung|kennung))?"
    r"|probekorper"
)
_DATE = (
    r"(general )?start ?(time|date|zeit)|(test|start|pruf|mess|versuchs)? ?(date|datum)|fecha"
    r"|(test|start|pruf|mess)? ?(date|datum)( and| und)? ?(time|uhrzeit|zeit)"
    r"|date (et )?heure|fecha y hora|data e ora|time ?stamp|zeitstempel"
)
_TIME = r"(start )?time|start ?(zeit|time)|uhrzeit|heure|hora|ora"
_BEGAN = (
    r"|(test )?(start(ed)?|beg[aiu]n|beginn(ing)?|recorded|measured|acquired|gestartet|gemessen"
    r"|debut|inicio|inizio)( (on|at|am|um|le|el|il))?"
)
# An English probe is a tip: the word names a specimen where the file is German.
_GERMAN = re.compile(r"\b(datum|pruf\w*|\w*zeit|\w*kraft|\w*weg)\b")
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]
_MONTH = r"(?P<word>[A-Z][a-z]{2})[a-z]*\.?"
_DAYS = (
    r"(?P<y>\d{4})([-/.])(?P<m>\d\d?)\2(?P<d>\d\d?)",
    r"(?P<d>\d\d?)\. ?(?P<m>\d\d?)\. ?(?P<y>\d{4})",
    r"(?P<one>\d\d?)([-/])(?P<other>\d\d?)\2(?P<y>\d{4})",
    rf"(\w+,? )?(?P<d>\d\d?)[ -]{_MONTH}[ -](?P<y>\d{{4}})",
    rf"(\w+,? )?{_MONTH} (?P<d>\d\d?),? (?P<y>\d{{4}})",
)
_MIDNIGHT = "00:00:00"
_NEXT_KEY = re.compile(r",\s*(?=[^\W\d][^:,;]*:\s*(?!\d\d\b))")  # 'Sample: A, operator: B'
_HOUR = re.compile(
    r"(?P<h>\d\d?):(?P<min>\d\d)(:(?P<s>\d\d)([.,]\d+)?)?( ?(?P<half>[AP])M)?(Z|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)


def stated_above(lines: Sequence[str], names: str = "", first: str = "") -> Stated:
    """Return what lines above a table's ``names`` state by keys that can mean nothing else.

    ``first`` is the first row's time where that is one of the day: the clock of the rows is then
    the test's own, on the day that it has or that a line states.
    """
    german = any(_GERMAN.search(plain_name(line)) for line in (*lines, names))
    specimen, named, date, clock = "", "", "", ""
    dated: list[str] = []
    for key, value, alone in _pairs(lines):
        word = plain_name(key)
        if alone and not specimen and re.fullmatch(_SPECIMEN, word):
            column = split_header(value)[1]  # the value names the next column of another table
            if not column and (german or word != "probe"):
                found = named_specimen(key, value)
                specimen, named = found.specimen, found.named
        elif not date and re.fullmatch(_DATE + _BEGAN, word) and _day(value):
            date = value
            dated.append(f"{key}: {value}")
        elif not clock and re.fullmatch(_TIME + _BEGAN, word) and _HOUR.fullmatch(value):
            clock = value
            dated.append(f"{key}: {value}")
    if first:
        own = first if _day(first) else ""
        dated = [f"the time of its first row, {first}", *(() if own else dated[:1])]
        date, clock = own or date, _MIDNIGHT
    began, either = _began(date, clock)
    return Stated(specimen, began, either, named, "" if began is None else ", ".join(dated))


def named_specimen(key: str, value: str) -> Stated:
    """Return the specimen that a key and its value name."""
    own = re.sub(r"^pad[ _]+", "", value, flags=re.IGNORECASE)  # it is told as "pad"
    return Stated(f"{key} {value}" if value.isdigit() else own, named=f"{key}: {value}")


def _pairs(lines: Sequence[str]) -> Iterator[tuple[str, str, bool]]:
    """Yield keys with their values, and whether a pair has a line of its own."""
    for line in lines:
        text = COMMENT.sub("", line).strip()
        mark = separator_of(text)
        cells = [cell for cell in cells_of(text, mark) if cell]
        for part in _NEXT_KEY.split(text) if mark == "," and len(cells) > 1 else cells:
            key, _, value = part.partition(":")
            if value.strip() and not re.search('[;,|"]', key):
                yield key.strip(), value.strip(" ,;"), True
        for k in range(0, len(cells) - 1, 2):
            yield cells[k].rstrip(" :"), cells[k + 1], len(cells) == 2


def _day(text: str) -> tuple[int, int, int, str] | None:
    """Return year, month and day at the beginning of a text, and the rest; month 0 if unclear."""
    for pattern in _DAYS:
        if (found := re.match(pattern, text)) is None:
            continue
        part = found.groupdict()
        rest = text[found.end() :].strip(" ,T")
        if "one" in part:
            one, other = int(part["one"]), int(part["other"])
            month_first = other > 12 or re.search("[AP]M", rest, re.IGNORECASE) is not None
            day, month = (other, one) if month_first else (one, other)
            clear = max(one, other) > 12 or one == other or month_first
            return int(part["y"]), month if clear else 0, day, rest
        word = (part.get("word") or "").lower()
        if not word or word in _MONTHS:
            month = _MONTHS.index(word) + 1 if word else int(part["m"])
            return int(part["y"]), month, int(part["d"]), rest
    return None


def _began(date: str, clock: str) -> tuple[float | None, str]:
    """Return a date and a time of the day as seconds since 1970, and a date that is unclear."""
    found = _day(date)
    time = _HOUR.fullmatch(clock or (found[3] if found else ""))
    if found is None or time is None:
        return None, ""
    year, month, day, _ = found
    hour = hour_of_day(int(time["h"]), time["half"])
    try:
        at = datetime(year, month or 1, day if month else 1, hour, int(time["min"]), tzinfo=UTC)
    except ValueError:  # there is no such day
        return None, ""
    seconds = float(time["s"] or 0)
    return at.timestamp() + seconds, "" if month else date.split()[0]
