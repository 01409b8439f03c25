"""Set-points of a series of tests, for a rig: where the platen has to be, 1 000 times a second."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.nexttest.design import Design
from qlvbayes.diagnosis.nexttest.rig import SET_POINTS
from qlvbayes.io.units import UnitSystem, column_name

Array = NDArray[np.float64]

PAUSE = "pause"
"""What the column ``test`` says while the pad recovers."""
_DIGITS = 9  # more than any rig resolves
_NOTHING = 1e-9  # of the depth: rounding


def names_of(count: int) -> list[str]:
    """Of the tests of a series."""
    return [f"next-{k + 1}" for k in range(count)]


def set_points(designs: Sequence[Design]) -> tuple[Array, Array, list[str]]:
    """Times (N,) from 0 on, displacements (N,), and the test that each is of.

    The clock runs on from the first test's first sample, through the pauses; the first test's own
    pause is before it. The way home at a test's end is part of it.
    """
    times, places, tests = [], [], []
    begin = 0
    for k, (name, design) in enumerate(zip(names_of(len(designs)), designs, strict=True)):
        if k:
            pause = max(round(design.wait * SET_POINTS) - 1, 0)
            times.append(begin + 1 + np.arange(pause))
            places.append(np.zeros(pause))
            tests += [PAUSE] * pause
            begin += pause + 1
        count = int(np.ceil(design.duration * SET_POINTS)) + 1
        own = np.arange(count)
        times.append(begin + own)
        places.append(design.whole.displacement(own / SET_POINTS))
        tests += [name] * count
        begin += count - 1
    place = np.concatenate(places)
    place = np.where(np.abs(place) > _NOTHING * place.max(), place, 0.0)
    return np.concatenate(times) / SET_POINTS, place, tests


def as_csv(designs: Sequence[Design], units: UnitSystem) -> str:
    """The file's text: time_s, displacement, test."""
    time, place, tests = set_points(designs)
    name = column_name(units.displacement_name, "" if units.dimensionless else units.displacement)
    rows = [
        f"{t:.3f},{x:.{_DIGITS}g},{test}" for t, x, test in zip(time, place, tests, strict=True)
    ]
    return "\n".join([f"time_s,{name},test", *rows]) + "\n"
