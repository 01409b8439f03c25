"""A program from a CSV file: a column of times, and one of displacements or of forces."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from qlvbayes.comparison.readings import RAMP_POINTS, hold
from qlvbayes.io.checks import InputError
from qlvbayes.io.columns import split_name
from qlvbayes.io.table import parse_number
from qlvbayes.io.text import content
from qlvbayes.io.units import SUFFIXES, UnitSystem, column_name
from qlvbayes.use.prescribed.program import MOST, Program

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
    quantity: Literal["displacement", "force"] = "displacement" if way else "force"
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
        ratio = scales[suffix].over(scales["" if own[quantity] == "1" else own[quantity]])
        columns[quantity] = index, ratio.up / ratio.down
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
