"""The set-points of a series of tests: where the platen has to be, 1 000 times a second."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.rig import SET_POINTS
from qlvbayes.io.arrays import Array
from qlvbayes.io.units import UnitSystem, column_name

PAUSE = "pause"
"""Entry of the column ``test`` while the pad recovers."""
_DIGITS = 9  # more than any rig resolves
_ROUNDING = 1e-9  # of the depth


def names_of(count: int) -> list[str]:
    """Return the names of the tests of a series."""
    return [f"next-{k + 1}" for k in range(count)]


def set_points(designs: Sequence[Design]) -> tuple[Array, Array, list[str]]:
    """Return times (N,) in s, displacements (N,) in mm, and the name of the test of each."""
    times, displacements, tests = [], [], []
    begin = 0
    for k, (name, design) in enumerate(zip(names_of(len(designs)), designs, strict=True)):
        if k:
            pause = max(round(design.wait * SET_POINTS) - 1, 0)
            times.append(begin + 1 + np.arange(pause))
            displacements.append(np.zeros(pause))
            tests += [PAUSE] * pause
            begin += pause + 1
        count = int(np.ceil(design.duration * SET_POINTS)) + 1
        own = np.arange(count)
        times.append(begin + own)
        displacements.append(design.whole.displacement(own / SET_POINTS))
        tests += [name] * count
        begin += count - 1
    position = np.concatenate(displacements)
    position = np.where(np.abs(position) > _ROUNDING * position.max(), position, 0.0)
    return np.concatenate(times) / SET_POINTS, position, tests


def as_csv(designs: Sequence[Design], units: UnitSystem) -> str:
    """Return the text of the file, with the columns time_s, displacement and test."""
    time, position, tests = set_points(designs)
    name = column_name(units.displacement_name, "" if units.dimensionless else units.displacement)
    rows = [
        f"{t:.3f},{x:.{_DIGITS}g},{test}" for t, x, test in zip(time, position, tests, strict=True)
    ]
    return "\n".join([f"time_s,{name},test", *rows]) + "\n"
