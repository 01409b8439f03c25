"""Read what the lines above a table state of its test: the specimen, and when it began."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime

from qlvbayes.io.columns import plain_name, split_header
from qlvbayes.io.recording import Stated
from qlvbayes.io.text import COMMENT, cells_of, hour_of_day, separator_of

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
_CLOCK = re.compile(
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
        elif not clock and re.fullmatch(_TIME + _BEGAN, word) and _CLOCK.fullmatch(value):
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
    time = _CLOCK.fullmatch(clock or (found[3] if found else ""))
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
