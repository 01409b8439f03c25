"""Programs: displacement or force prescribed over time, in words or in a CSV file.

In words as "ramp 1.6 mm at 20 mm/s, hold 30 s, sine 0.1 mm 1 Hz 10 cycles"; in a file as a column
of times, and one of displacements or of forces.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NoReturn

import numpy as np

from qlvbayes.comparison.readings import PIECES, RAMP_POINTS, Course, hold, joined, ramp
from qlvbayes.io import wording
from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import split_name
from qlvbayes.io.table import parse_number
from qlvbayes.io.text import content
from qlvbayes.io.units import STRAIN, SUFFIXES, UnitRatio, UnitSystem, column_name

Quantity = Literal["displacement", "force"]

MOST = 50_000  # points; 400 draws of them are 160 MB


@dataclass(frozen=True, eq=False)
class Program:
    """Points (N,) between which the prescribed quantity goes straight, from a specimen at rest."""

    title: str  # the text that was given, or the name of its file
    quantity: Quantity  # the prescribed quantity
    time: np.ndarray  # times (N,) in s, never decreasing
    value: np.ndarray  # displacement or force (N,) in the units of the fit
    rate: np.ndarray  # its slope (N,) just after each point, per s

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times (s) of its jumps: two points of one time with different values."""
        jumping = (np.diff(self.time) == 0.0) & (np.diff(self.value) != 0.0)
        return tuple(self.time[:-1][jumping].tolist())

    @property
    def longest_rest(self) -> float:
        """Longest time (s) for which the value stays as it is."""
        same = np.diff(self.value) == 0.0
        longest = began = 0.0
        for k, still in enumerate(same):
            began = began if still and k and same[k - 1] else float(self.time[k])
            longest = max(longest, float(self.time[k + 1]) - began) if still else longest
        return longest


_TOKEN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[^\s\d.+-][^\s]*|\S+")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_SECONDS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_HERTZ = {"Hz": 1.0, "mHz": 1e-3}
_GIVEN = {"at": "a speed", "in": "a time"}
_CYCLES = {"cycles": 1.0, "cycle": 1.0}
_FORMS = (
    "'ramp 1.6 mm at 20 mm/s', 'ramp 1.6 mm in 0.1 s', 'hold 30 s', 'sine 0.1 mm 1 Hz 10 cycles', "
    "'force 1 N in 0.1 s'"
)


def parse(text: str, units: UnitSystem) -> Program:
    """Read phrases, separated by commas; every program begins at zero, at rest."""
    phrases = [phrase.strip() for phrase in re.split(r"[,;\n]", text) if phrase.strip()]
    if not phrases:
        raise InputError("the program is empty", remedy=f"write {_FORMS}")
    course, quantity = Course(np.zeros(1), np.zeros(1), np.zeros(1)), None
    for phrase in phrases:
        words = _Words(phrase, units, quantity)
        part = _part(words, float(course.time[-1]), float(course.depth[-1]))
        course, quantity = joined([course, part]), words.quantity
        if course.time.size > MOST:
            raise InputError(
                f"up to '{phrase}' the program has {course.time.size} points",
                remedy=f"use {MOST} or fewer",
            )
    if quantity is None:
        raise InputError("the program only holds", remedy=f"write {_FORMS}")
    time, value, rate = (x[1:] for x in (course.time, course.depth, course.velocity))
    return Program(text, quantity, time, value, rate)


def _part(words: _Words, start: float, position: float) -> Course:
    kind = words.choose(("ramp", "hold", "sine", "force"), "begin with")
    if kind == "hold":
        part = hold(start, position, words.positive(_SECONDS, "a time"))
    elif kind == "sine":
        part = _sine(words, start, position)
    else:
        part = _ramp(words, start, position, "force" if kind == "force" else None)
    words.end()
    return part


def _ramp(words: _Words, start: float, position: float, wanted: Quantity | None) -> Course:
    words.skip("to")
    target = words.value(wanted)
    how = words.choose(("at", "in"), "go on with")
    given = words.positive(words.rates() if how == "at" else _SECONDS, _GIVEN[how])
    if target == position:
        raise InputError(f"'{words.phrase}' goes nowhere", remedy="write a hold instead")
    return ramp(start, position, target, given if how == "at" else abs(target - position) / given)


def _sine(words: _Words, start: float, position: float) -> Course:
    """Return straight pieces whose ends are exact, as are the rates there."""
    size = words.value(None)
    hertz = words.positive(_HERTZ, "a frequency")
    count = words.positive(_CYCLES, "a number of cycles")
    points = max(round(count * PIECES), 1)
    if points > MOST:
        raise InputError(f"{count:g} cycles are {points} points", remedy=f"use {MOST} or fewer")
    turns = np.linspace(0.0, 2.0 * np.pi * count, points + 1)
    rate = 2.0 * np.pi * hertz * size * np.cos(turns)
    return Course(start + turns / (2.0 * np.pi * hertz), position + size * np.sin(turns), rate)


class _Words:
    """The words of a phrase, taken one after the other."""

    def __init__(self, phrase: str, units: UnitSystem, quantity: Quantity | None) -> None:
        """Split a phrase; ``quantity`` is what the phrases before it prescribe."""
        self.phrase, self._left = phrase, _TOKEN.findall(phrase)
        self.quantity = quantity
        own = (units.displacement_name, units.displacement), (units.force_name, units.force)
        length, load = (_factors(*one) for one in own)
        self._factors: dict[Quantity, dict[str, float]] = {"displacement": length, "force": load}

    def choose(self, known: Sequence[str], ask: str) -> str:
        """Return the next word, one of those that are known."""
        word = self._next()
        if word.lower() not in known:
            self._refuse(word, f"{ask} {_either(known)}")
        return word.lower()

    def skip(self, word: str) -> None:
        """Skip a word that need not be there."""
        if self._left and self._left[0].lower() == word:
            self._left.pop(0)

    def value(self, wanted: Quantity | None) -> float:
        """Return a displacement or a force, in the units of the fit."""
        number, word = self._number("a displacement or a force"), self._next()
        known = self._factors if wanted is None else {wanted: self._factors[wanted]}
        quantity = next((key for key, factors in known.items() if word in factors), None)
        if quantity is None:
            self._refuse(word, f"use {_either([unit for f in known.values() for unit in f])}")
        if self.quantity not in (None, quantity):
            raise InputError(
                f"'{self.phrase}' prescribes the {quantity}, what stands before it the "
                f"{self.quantity}",
                remedy="prescribe one of them in the whole program",
            )
        self.quantity = quantity
        return number * known[quantity][word]

    def positive(self, factors: Mapping[str, float], what: str) -> float:
        """Return a number above 0 and its unit."""
        number, word = self._number(what), self._next()
        if word not in factors:
            self._refuse(word, f"give {what} in {_either(tuple(factors))}")
        if number <= 0.0:
            raise InputError(f"{what} of {number:g} in '{self.phrase}'", remedy="give it above 0")
        return number * factors[word]

    def rates(self) -> dict[str, float]:
        """Return the units of the rate of the prescribed quantity."""
        assert self.quantity is not None
        return {f"{unit}/s": factor for unit, factor in self._factors[self.quantity].items()}

    def end(self) -> None:
        """Refuse words that are left."""
        if self._left:
            self._refuse(self._left[0], "end the phrase there, or put a comma before what follows")

    def _number(self, what: str) -> float:
        word = self._next()
        if not _NUMBER.fullmatch(word):
            self._refuse(word, f"give {what} as a number")
        return float(word)

    def _next(self) -> str:
        if not self._left:
            raise InputError(f"'{self.phrase}' breaks off", remedy=f"write {_FORMS}")
        return self._left.pop(0)

    def _refuse(self, word: str, remedy: str) -> NoReturn:
        raise InputError(f"'{word}' is not understood in '{self.phrase}'", remedy=remedy)


def _factors(name: str, own: str) -> dict[str, float]:
    """Return what a number in each unit is multiplied by to be in one's own."""
    if own == STRAIN.displacement:
        return {"strain": 1.0}
    scales = SUFFIXES[name]
    return {unit: _factor(scale, scales[own]) for unit, scale in scales.items()}


def _factor(scale: UnitRatio, base: UnitRatio) -> float:
    ratio = scale.over(base)
    return ratio.up / ratio.down


_LONG = 0.01  # of the program: stretches of a table that get points of their own,
_FEW = 100  # and up to so many rows all of them do
_STRAIGHT = 1e-8  # of the largest value: rows so near to the line between their neighbours,
_FAITHFUL = 1e-6  # that may be left out if all of them together are no farther from it than this


def read_table(path: Path, units: UnitSystem) -> Program:
    """Read columns time_s and displacement_mm, or time_s and force_N, or other units of them."""
    lines = content(path).decode("utf-8", "replace").splitlines()
    if not lines:
        raise InputError("the file is empty", file=path, remedy="write time_s,displacement_mm")
    separator = max(";\t,", key=lines[0].count)
    names = [name.strip().strip('"') for name in lines[0].split(separator)]
    columns = _columns(names, units, path)
    decimal = "," if separator == ";" else "."
    rows = [
        [_cell(line.split(separator), column, names, decimal, path, k) for column, _ in columns]
        for k, line in enumerate(lines[1:], start=2)
        if line.strip()
    ]
    if len(rows) < 2:
        raise InputError(f"{len(rows)} rows", file=path, remedy=f"give 2 to {MOST}")
    time, value = (np.array(rows) * [factor for _, factor in columns]).T
    if np.any(back := np.diff(time) < 0.0):
        line = int(np.flatnonzero(back)[0]) + 3
        raise InputError("time runs back", file=path, line=line, remedy="sort the rows")
    same = np.flatnonzero(np.diff(time) == 0.0)
    if (thrice := same[1:][np.diff(same) == 1]).size or same.size == time.size - 1:
        raise InputError(
            "three rows have one time" if thrice.size else "time does not go on",
            file=path,
            line=int(thrice[0] if thrice.size else same[0]) + 3,
            remedy="write a jump as two rows of one time, or give it a rise time",
        )
    if time.size > MOST:
        time, value = _corners(time, value)
    if time.size > MOST:
        raise InputError(
            f"{time.size} rows that are not on straight lines",
            file=path,
            remedy=f"give 2 to {MOST}",
        )
    quantities = {split[0] for name in names if (split := split_name(name))}
    way = bool(quantities & {"displacement", "strain"})
    quantity: Quantity = "displacement" if way else "force"
    if quantity == "force":
        between = _crept(time)
        times = np.concatenate([time, between])
        order = np.argsort(times, kind="stable")  # the two rows of a jump stay as they are
        value = np.concatenate([value, np.interp(between, time, value)])[order]
        time = times[order]
    moving = np.diff(time) > 0.0
    slopes = np.where(moving, np.diff(value) / np.where(moving, np.diff(time), 1.0), 0.0)
    return Program(path.name, quantity, time, value, np.append(slopes, 0.0))


def _corners(time: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows between which it goes straight, as a rig's set-points do."""
    size = float(np.max(np.abs(value)))
    width = time[2:] - time[:-2]
    share = (time[1:-1] - time[:-2]) / np.where(width > 0.0, width, 1.0)
    off = np.abs(value[1:-1] - value[:-2] - share * (value[2:] - value[:-2]))
    kept = np.concatenate([[True], off > _STRAIGHT * size, [True]])
    once = ~np.isin(time, time[1:][np.diff(time) == 0.0])  # at a jump there is no one value
    error = np.max(np.abs(np.interp(time, time[kept], value[kept]) - value), where=once, initial=0)
    return (time[kept], value[kept]) if error <= _FAITHFUL * size else (time, value)


def _crept(time: np.ndarray) -> np.ndarray:
    """Return times of creep in long stretches, over which displacement is not straight."""
    width = np.diff(time)
    long = (width > _LONG * (time[-1] - time[0])) | (width.size <= _FEW)
    between = [np.empty(0)]
    for k in np.flatnonzero(long):
        between += [hold(time[k], 0.0, width[k]).time[1:-1]]
        between += [np.linspace(time[k], time[k + 1], RAMP_POINTS)[1:-1]]
    return np.unique(np.concatenate(between))


def _columns(names: list[str], units: UnitSystem, path: Path) -> list[tuple[int, float]]:
    """Return index and factor to the units of the fit, of the two columns."""
    own = {"time": "s", units.displacement_name: units.displacement, units.force_name: units.force}
    expected = [column_name(key, "" if unit == "1" else unit) for key, unit in own.items()]
    columns: dict[str, tuple[int, float]] = {}
    for index, name in enumerate(names):
        quantity, suffix = split_name(name) or ("", "")
        if quantity not in own or suffix not in SUFFIXES[quantity]:
            continue
        if quantity in columns:
            raise InputError(f"two columns of {quantity}", file=path, line=1, remedy="keep one")
        scales = SUFFIXES[quantity]
        base = scales["" if own[quantity] == "1" else own[quantity]]
        columns[quantity] = index, _factor(scales[suffix], base)
    if "time" not in columns or len(columns) != 2:
        raise InputError(
            f"the columns are {', '.join(names)}",
            file=path,
            line=1,
            remedy=f"give {expected[0]} and one of {expected[1]} and {expected[2]}",
        )
    return [columns.pop("time"), *columns.values()]


def _cell(
    cells: list[str], column: int, names: list[str], decimal: str, path: Path, line: int
) -> float:
    text = cells[column].strip() if column < len(cells) else ""
    number = parse_number(text, decimal)
    if number is None or not np.isfinite(number):
        raise InputError(
            f"{names[column]} is not a number ('{text}')",
            file=path,
            line=line,
            remedy="write a number or delete the row",
        )
    return number


def _either(words: Sequence[str]) -> str:
    return wording.joined(list(words), "or")
