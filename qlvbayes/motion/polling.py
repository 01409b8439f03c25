"""Channels that were read more slowly than the rows, and repeated until they were read anew.

A controller that answers five times a second while the load cell is read fifty times leaves rows in
which the displacement stays for ten rows and jumps at the eleventh (a zero-order hold). The platen
made no such jumps: its motion is read in the first row of each repeat alone.

A load cell that answers ten times a second beside an encoder read a hundred times leaves rows in
which the force stays while the platen goes on, and then jumps. Taken for readings these rows are
late by half an interval, and their noise looks correlated: only the first row of each repeat is a
reading. A coarse converter also repeats values, where the force changes by less than its step from
row to row; but then it changes by one step at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array, Mask
from qlvbayes.io.data import Pad, Test
from qlvbayes.motion.clean import without

_FEWEST_REPEATS = 5  # repeats of one length that show it,
_REGULAR = 0.95  # and so many of all changes are multiples of it apart: a lost row shifts one
_VARIED = 1.5  # times the smallest change: an encoder's stairs have equal changes,
_LARGE_STEP = 0.1  # or are so much of the range each: no encoder is so coarse
_CLEAR = 0.1  # of the largest change: smaller ones are scatter at rest
_SHOWN = 0.05  # of the force's range, that it changes by in these repeats, in all,
_WITHIN = 0.5  # and at least so much of its even share between the changes
_FEWEST = 8  # changes of the force that show it,
_AT_REST = 30  # and more of them where the platen rests;
_LARGE = 2.5  # of the smallest change: half of them are larger, as no converter's are that repeats,
_REPEATED = 0.6  # and as many of them follow a row that repeats the one before it
_MOVES = 0.02  # of the displacement's range, by which the platen moves about such a change at least
_AGAIN = 1.5  # times the common repeat: in a longer one the force was read anew, and was the same


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
    if gaps.size < _FEWEST_REPEATS:
        return 0
    rows = int(np.bincount(gaps).argmax())
    regular = np.count_nonzero(gaps == rows) >= _FEWEST_REPEATS and _regular(change, rows)
    if rows < 2 or not regular:
        return 0
    sizes = np.abs(x[change] - x[change - 1])
    varied = sizes.max() > _VARIED * sizes.min() or np.median(sizes) > _LARGE_STEP * np.ptp(x)
    return rows if varied and _force_goes_on(test, change, rows) else 0


def _changes(values: Array) -> NDArray[np.intp]:
    """Return the rows whose value is not that of the row before."""
    return np.flatnonzero(np.diff(values) != 0.0) + 1


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
    nth = "th" if rows % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(rows % 10, "th")
    return (
        f"pad {pad}: in test {test.name} the displacement is read only every {rows}{nth} row "
        "and repeated between, while the force goes on; the motion goes smoothly from one of these "
        f"readings to the next{ending}"
    )


def fresh_forces(tests: Sequence[Test]) -> list[Mask | None]:
    """Return in which rows (n,) of each test of one load cell its force was read; None: in all."""
    rows = [_rows_of(test, True, _FEWEST) or _rows_of(test, False, _AT_REST) for test in tests]
    if not any(rows):
        return [None] * len(tests)
    # one load cell reads all tests: one that is too quick to show it is judged at rest as well
    every = zip(tests, rows, strict=True)
    rows = [known or _rows_of(test, False, _FEWEST) for test, known in every]
    return [_fresh(test.force, k) if k else None for test, k in zip(tests, rows, strict=True)]


def _rows_of(test: Test, while_moving: bool, fewest: int) -> float:
    """Return for how many rows a reading of force is repeated; 0 if that does not show."""
    change = _changes(test.force)
    if change.size < fewest:
        return 0.0
    repeats, sizes = np.diff(change, prepend=0), np.abs(np.diff(test.force))[change - 1]
    common, shown = float(np.median(repeats)), np.ones(change.size, dtype=bool)
    if while_moving:  # also in the rows that repeat a force
        way, reach = test.displacement, max(int(common), 2)
        least = _MOVES * float(np.ptp(way)) / max(change.size / 10.0, 1.0)
        before, just = way[np.maximum(change - reach, 0)], way[change - 1]
        after = way[np.minimum(change + reach, way.size) - 1]
        shown = (np.abs(just - before) > least) & (np.abs(after - just) > least)
    large = shown & (sizes > _LARGE * float(sizes.min()))
    seen = np.count_nonzero(shown)
    if seen < _FEWEST or common < 2.0 or np.count_nonzero(large) < max(_FEWEST, 0.5 * seen):
        return 0.0
    return common if np.mean(repeats[large] > 1) >= _REPEATED else 0.0


def _fresh(force: Array, rows: float) -> Mask:
    """Return the first row of each repeat, and where one goes on for long the later readings."""
    first = np.append(0, _changes(force))
    fresh = np.zeros(force.size, dtype=bool)
    fresh[first] = True
    every = max(round(rows), 1)
    for begin, end in zip(first, np.append(first[1:], force.size), strict=True):
        if end - begin > _AGAIN * rows:
            fresh[begin : end - every // 2 : every] = True
    return fresh


def with_fresh(test: Test, fresh: Mask | None) -> Test:
    """Return a test of which only fresh readings of force are used, with lines between them."""
    if fresh is None:
        return test
    used = fresh if test.used is None else fresh & test.used
    force = np.interp(test.time, test.time[fresh], test.force[fresh])
    return replace(test, force=np.where(fresh, test.force, force), used=used)


def held_notices(pad: str, tests: Sequence[Test], fresh: Sequence[Mask | None]) -> tuple[str, ...]:
    """Return a sentence on each test whose force was read more slowly than the rows."""
    return tuple(
        f"pad {pad}: in test {test.name} the force is read only about every "
        f"{test.time.size / np.count_nonzero(mask):.2g} rows ({np.count_nonzero(mask)} readings in "
        f"{test.time.size} rows) and repeated between, while the platen goes on; only the first "
        "row of each repeat is taken for a reading of the force"
        for test, mask in zip(tests, fresh, strict=True)
        if mask is not None
    )
