"""Check that a test can be used by the model: order in time, motion, force."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.io.reading.clock import slipped
from qlvbayes.io.reading.header import Columns
from qlvbayes.io.reading.table import Table

LEAST_SAMPLES = 10


@dataclass(frozen=True)
class Rows:
    """Rows of one test in the table, as stretches, with the names of pad and test."""

    pad: str
    test: str
    stretches: tuple[slice, ...]

    def take(self, column: Floats) -> Floats:
        """Return the test's part of a column; it is a view where its rows lie together."""
        if len(self.stretches) == 1:
            return column[self.stretches[0]]
        return np.concatenate([column[stretch] for stretch in self.stretches])

    def after(self, samples: int) -> Rows:
        """Return the rows without the first samples."""
        kept = []
        for stretch in self.stretches:
            lost = min(samples, stretch.stop - stretch.start)
            samples -= lost
            if stretch.start + lost < stretch.stop:
                kept.append(slice(stretch.start + lost, stretch.stop))
        return Rows(self.pad, self.test, tuple(kept))

    def row(self, sample: int) -> int:
        """Return the row of the table that holds a sample of the test."""
        for stretch in self.stretches:
            size = stretch.stop - stretch.start
            if sample < size:
                return int(stretch.start + sample)
            sample -= size
        raise IndexError(sample)


@dataclass(frozen=True)
class Checker:
    """Checks of a test; one that fails is refused with the line and the remedy."""

    file: Path
    table: Table
    columns: Columns

    def check(
        self,
        rows: Rows,
        readings: dict[str, Floats],
        *,
        loaded: bool = False,
        used: NDArray[np.bool_],
    ) -> None:
        """Raise InputError unless the test can be used."""
        self._time(rows, readings["time"])
        if (size := len(readings["time"])) < LEAST_SAMPLES:
            what = f"{_title(rows)} has {size} rows, at least {LEAST_SAMPLES} are needed"
            self.fail(rows, 0, what, "add the missing rows or delete the test")
        if (kept := np.count_nonzero(used)) < LEAST_SAMPLES:
            what = f"the column use keeps {kept} rows of {_title(rows)}, and "
            what += f"at least {LEAST_SAMPLES} are needed"
            self.fail(rows, 0, what, "write 1 in more of its rows or delete the test")
        force = readings["force"][used]
        for key, values in (("displacement", readings["displacement"]), ("force", force)):
            held = key == "force" and loaded and values.max() > 0.0
            if values.min() == values.max() and not held:
                what = f"{self._name(key)} never changes in {_title(rows)}"
                self.fail(rows, 0, what, "check the channel or delete the test")
        if "force_sd" in readings and readings["force_sd"].min() <= 0:
            bad = int(np.argmax(readings["force_sd"] <= 0))
            what = f"{self._name('force_sd')} is not positive ({readings['force_sd'][bad]:g})"
            self.fail(rows, bad, what, "write its standard deviation or delete the column")
        self._signs(rows, readings["displacement"][used], force)

    def fail(self, rows: Rows, sample: int, message: str, remedy: str) -> NoReturn:
        """Raise the error at a sample of the test."""
        line = self.table.line(rows.row(sample))
        raise InputError(message, file=self.file, line=line, remedy=remedy)

    def _name(self, key: str) -> str:
        return self.columns.numeric[key].name

    def _time(self, rows: Rows, time: Floats) -> None:
        """Refuse time that does not increase but for single slips, and say how it fails."""
        if slipped(time) is not None:
            return
        stuck = time[1:] <= time[:-1]
        index = int(np.argmax(stuck)) + 1
        before, now = float(time[index - 1]), float(time[index])
        where = f"in {_title(rows)} ({now:.9g} s after {before:.9g} s)"
        name = self._name("time")
        if now == before:
            remedy = "write time with more decimals or delete the repeated row"
            self.fail(rows, index, f"{name} repeats {where}", remedy)
        if now - time[0] > 0.1 * (before - time[0]):
            self.fail(rows, index, f"{name} runs backwards {where}", "sort the test's rows by time")
        named = "test" in self.columns.labels
        remedy = "give each test its own name" if named else "add a test column naming each test"
        self.fail(rows, index, f"{name} restarts {where}", remedy)

    def _signs(self, rows: Rows, displacement: Floats, force: Floats) -> None:
        """Refuse a pad whose force or displacement is clearly of the wrong sign."""
        wrong = wrong_signs(displacement, force)
        if wrong and not (self.columns.units.dimensionless and len(wrong) > 1):
            names = " and ".join(self._name(key) for key in wrong)
            what = f"in {_title(rows)} the specimen is loaded with {names} of the wrong sign"
            self.fail(rows, 0, what, f"multiply {names} by -1")


def wrong_signs(displacement: Floats, force: Floats) -> tuple[str, ...]:
    """Return which of displacement and force decrease in the first loading, if that is clear."""
    away = np.abs(displacement - displacement[0])
    end = int(np.argmax(away >= 0.95 * away.max())) + 1
    d, f = displacement[:end], force[:end]
    small = away.max() <= 0.05 * np.abs(displacement).max()
    if small or d.min() == d.max() or f.min() == f.max():
        return ()
    along = float(np.corrcoef(d, f)[0, 1])
    grows = bool(d[-1] > d[0])
    low, high = float(force.min()), float(force.max())
    pulled, pressed = high <= -0.2 * low, low >= -0.2 * high
    if grows and along < -0.8 and pulled:
        return ("force",)
    if not grows and along < -0.8 and pressed and abs(f[0]) < 0.2 * high:
        return ("displacement",)
    below = displacement.max() <= -0.05 * displacement.min()
    if not grows and along > 0.8 and pulled and below:
        return "displacement", "force"
    return ()


def _title(rows: Rows) -> str:
    return f"test '{rows.test}' of pad '{rows.pad}'"
