"""A program from a CSV file: a column of times, and one of displacements or of forces."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from qlvbayes.comparison.programmes import RAMP_POINTS, hold
from qlvbayes.io.checks import InputError
from qlvbayes.io.reading.badline import parse_number
from qlvbayes.io.reading.csvtext import blocks
from qlvbayes.io.reading.header import split_name
from qlvbayes.io.units import SUFFIXES, UnitSystem, column_name
from qlvbayes.use.prescribed.program import MOST, Program

_INSTANT = 1e-6  # of the shortest step: how long a jump takes
_LONG = 0.01  # of the program: stretches of a table that get points of their own,
_FEW = 100  # and up to so many rows all of them do
_STRAIGHT = 1e-8  # of the largest value: rows so near to the line between their neighbours,
_FAITHFUL = 1e-6  # that may be left out if all of them together are no farther from it than this


def read_table(path: Path, units: UnitSystem) -> Program:
    """Columns time_s and displacement_mm, or time_s and force_N, or other units of the same.

    Time increases; two rows of one time are a jump, made within a millionth of the program's
    shortest step, in which what goes with the speed makes no force. Semicolons mean decimal commas.
    Raises InputError with file and line.
    """
    lines = b"".join(blocks(path)).decode("utf-8-sig").splitlines()
    if not lines:
        raise InputError("the file is empty", file=path, remedy="write time_s,displacement_mm")
    separator = max(";\t,", key=lines[0].count)
    names = [name.strip().strip('"') for name in lines[0].split(separator)]
    places = _columns(names, units, path)
    decimal = "," if separator == ";" else "."
    rows = [
        [_cell(line.split(separator), column, names, decimal, path, k) for column, _ in places]
        for k, line in enumerate(lines[1:], start=2)
        if line.strip()
    ]
    if len(rows) < 2:
        raise InputError(f"{len(rows)} rows", file=path, remedy=f"give 2 to {MOST}")
    time, value = (np.array(rows) * [factor for _, factor in places]).T
    time, jumps = _with_jumps(time, path)
    if time.size > MOST:
        time, value = _corners(time, value)
    if time.size > MOST:
        raise InputError(
            f"{time.size} rows that are not on straight lines",
            file=path,
            remedy=f"give 2 to {MOST}",
        )
    quantity = _quantity(names)
    if quantity == "force":
        finer = _crept(time)
        time, value = finer, np.interp(finer, time, value)
    slopes = np.append(np.diff(value) / np.diff(time), 0.0)
    slopes[np.isin(time, jumps)] = 0.0  # in a jump nothing flows, and no speed is told of it
    return Program(path.name, quantity, time, value, slopes, tuple(jumps.tolist()))


def _with_jumps(time: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times that increase, and those of jumps: the second row of a time comes an instant later.

    Raises InputError where time falls, or three rows have one time.
    """
    steps = np.diff(time)
    if (back := np.flatnonzero(steps < 0.0)).size:
        line = int(back[0]) + 3
        raise InputError("time falls", file=path, line=line, remedy="sort the rows by time")
    same = np.flatnonzero(steps == 0.0)
    if (thrice := same[1:][np.diff(same) == 1]).size or same.size == steps.size:
        line = int(thrice[0] if thrice.size else same[0]) + 3
        raise InputError(
            "three rows have one time" if thrice.size else "time does not go on",
            file=path,
            line=line,
            remedy="write a jump as two rows of one time, or give it a rise time",
        )
    moved = time.copy()
    moved[same + 1] += _INSTANT * float(np.min(steps[steps > 0.0]))
    return moved, time[same]


def _corners(time: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows between which it goes straight, as a rig's set-points do; all where it does not."""
    size = float(np.max(np.abs(value)))
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    off = np.abs(value[1:-1] - value[:-2] - share * (value[2:] - value[:-2]))
    kept = np.concatenate([[True], off > _STRAIGHT * size, [True]])
    error = np.max(np.abs(np.interp(time, time[kept], value[kept]) - value))
    return (time[kept], value[kept]) if error <= _FAITHFUL * size else (time, value)


def _crept(time: np.ndarray) -> np.ndarray:
    """Times with those of creep in long stretches, over which displacement is not straight."""
    width = np.diff(time)
    long = (width > _LONG * (time[-1] - time[0])) | (width.size <= _FEW)
    between = [time]
    for k in np.flatnonzero(long):
        between += [hold(time[k], 0.0, width[k]).time[1:-1]]
        between += [np.linspace(time[k], time[k + 1], RAMP_POINTS)[1:-1]]
    return np.unique(np.concatenate(between))


def _quantity(names: list[str]) -> Literal["displacement", "force"]:
    found = {split[0] for name in names if (split := split_name(name))}
    return "displacement" if found & {"displacement", "strain"} else "force"


def _columns(names: list[str], units: UnitSystem, path: Path) -> list[tuple[int, float]]:
    """Place and factor to the units of the fit, of time and of what is prescribed."""
    own = {"time": "s", units.displacement_name: units.displacement, units.force_name: units.force}
    usual = [column_name(key, "" if unit == "1" else unit) for key, unit in own.items()]
    found: dict[str, tuple[int, float]] = {}
    for place, name in enumerate(names):
        quantity, suffix = split_name(name) or ("", "")
        if quantity not in own or suffix not in SUFFIXES[quantity]:
            continue
        if quantity in found:
            raise InputError(f"two columns of {quantity}", file=path, line=1, remedy="keep one")
        scales = SUFFIXES[quantity]
        ratio = scales[suffix].over(scales["" if own[quantity] == "1" else own[quantity]])
        found[quantity] = place, ratio.up / ratio.down
    if "time" not in found or len(found) != 2:
        raise InputError(
            f"the columns are {', '.join(names)}",
            file=path,
            line=1,
            remedy=f"give {usual[0]} and one of {usual[1]} and {usual[2]}",
        )
    return [found.pop("time"), *found.values()]


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
