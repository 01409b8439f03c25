"""Programs in words: "ramp 1.6 mm at 20 mm/s, hold 30 s, sine 0.1 mm 1 Hz 10 cycles"."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Literal, NoReturn

import numpy as np

from qlvbayes.comparison.readings import PIECES, Course, hold, joined, ramp
from qlvbayes.io.checks import InputError
from qlvbayes.io.units import STRAIN, SUFFIXES, UnitRatio, UnitSystem
from qlvbayes.use.prescribed.program import MOST, Program

Quantity = Literal["displacement", "force"]
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

    def factor(scale: UnitRatio) -> float:
        ratio = scale.over(scales[own])
        return ratio.up / ratio.down

    return {unit: factor(scale) for unit, scale in scales.items()}


def _either(words: Sequence[str]) -> str:
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last
