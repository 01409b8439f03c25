"""Displacements that were read more slowly than the force, and repeated until they were read anew.

A controller that answers five times a second while the load cell is read fifty times leaves rows in
which the displacement stays for ten rows and jumps at the eleventh (a zero-order hold). The platen
made no such jumps: its motion is read in the first row of each repeat alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Pad, Test
from qlvbayes.motion.badreadings import without

_FEWEST = 5  # repeats of one length that show it,
_REGULAR = 0.95  # and so many of all changes are multiples of it apart: a lost row shifts one
_VARIED = 1.5  # times the smallest change: an encoder's stairs have equal changes,
_LARGE = 0.1  # or are so much of the range each: no encoder is so coarse
_CLEAR = 0.1  # of the largest change: smaller ones are scatter at rest
_SHOWN = 0.05  # of the force's range, that it changes by in these repeats, in all,
_WITHIN = 0.5  # and at least so much of its even share between the changes


def with_own_readings(pad: Pad) -> tuple[Pad, tuple[str, ...]]:
    """Return a pad with displacements between their readings, and a sentence on each such test."""
    lengths = [repeated_rows(test) for test in pad.tests]
    intervals = [float(np.median(np.diff(test.time))) for test in pad.tests]
    shown = [k * interval for k, interval in zip(lengths, intervals, strict=True) if k]
    tests, notices = list(pad.tests), []
    for i, (test, length) in enumerate(zip(pad.tests, lengths, strict=True)):
        rows = length or (round(float(np.median(shown)) / intervals[i]) if shown else 0)
        if rows < 2 or not _regular(_changes(test.displacement), rows):
            continue
        tests[i] = _between_readings(test, rows)
        notices.append(_notice(pad.name, test, rows, test.time.size - tests[i].time.size))
    return replace(pad, tests=tuple(tests)), tuple(notices)


def repeated_rows(test: Test) -> int:
    """Return for how many rows each reading of displacement is repeated; 0 if that is not clear."""
    x = test.displacement
    change = _changes(x)
    gaps = np.diff(change)
    if gaps.size < _FEWEST:
        return 0
    rows = int(np.bincount(gaps).argmax())
    regular = np.count_nonzero(gaps == rows) >= _FEWEST and _regular(change, rows)
    if rows < 2 or not regular:
        return 0
    sizes = np.abs(x[change] - x[change - 1])
    varied = sizes.max() > _VARIED * sizes.min() or np.median(sizes) > _LARGE * np.ptp(x)
    return rows if varied and _force_goes_on(test, change, rows) else 0


def _changes(displacement: Array) -> NDArray[np.intp]:
    """Return the rows whose displacement is not that of the row before."""
    return np.flatnonzero(np.diff(displacement) != 0.0) + 1


def _regular(change: NDArray[np.intp], rows: int) -> bool:
    """Return whether there are changes, nearly all of them multiples of so many rows apart."""
    gaps = np.diff(change)
    return change.size > 0 and (gaps.size == 0 or bool(np.mean(gaps % rows == 0) >= _REGULAR))


def _force_goes_on(test: Test, change: NDArray[np.intp], rows: int) -> bool:
    """Return whether the force changes in the repeats as it does where the displacement changes."""
    moves = test.displacement[change] - test.displacement[change - 1]
    moving = np.abs(moves[:-1]) > _CLEAR * np.abs(moves).max()
    some = moving & (np.diff(change) == rows)
    first, way = change[:-1][some], np.sign(moves[:-1][some])
    within = float(way @ (test.force[first + rows - 1] - test.force[first]))
    every = float(way @ (test.force[first + rows - 1] - test.force[first - 1]))
    even = every * (rows - 1) / rows
    return every > _SHOWN * float(np.ptp(test.force)) and within > _WITHIN * even


def _between_readings(test: Test, rows: int) -> Test:
    """Return a test with its displacement on straight lines between the rows that were read."""
    time, x = test.time, test.displacement
    change = _changes(x)
    before = np.arange(change[0] % rows, change[0], rows)
    ends = [*change[1:].tolist(), time.size]
    read = np.concatenate(
        [before, *(np.arange(*ends_of, rows) for ends_of in zip(change, ends, strict=True))]
    ).astype(int)
    anew = np.zeros(time.size, dtype=bool)
    anew[read] = True
    since, earlier = time[read], x[read]
    if read[0] > 0:  # the first rows repeat what was read before the record began
        early = time[0] - (rows - read[0]) * float(np.median(np.diff(time)))
        since, earlier = np.append(early, since), np.append(x[0], earlier)
    test = replace(test, displacement=np.interp(time, since, earlier), anew=anew)
    moving = read.size > 1 and x[read[-1]] != x[read[-2]]
    return without(test, np.arange(time.size) > read[-1]) if moving else test


def _notice(pad: str, test: Test, rows: int, left_out: int) -> str:
    ending = f"; its last {left_out} rows, in which it moves on, are left out" if left_out else ""
    return (
        f"pad {pad}: in test {test.name} the displacement is read only every {_ordinal(rows)} row "
        "and repeated between, while the force goes on; the motion goes smoothly from one of these "
        f"readings to the next{ending}"
    )


def _ordinal(number: int) -> str:
    """Return '2nd', '3rd', '10th'."""
    teens = number % 100 in (11, 12, 13)
    return f"{number}{'th' if teens else {1: 'st', 2: 'nd', 3: 'rd'}.get(number % 10, 'th')}"
