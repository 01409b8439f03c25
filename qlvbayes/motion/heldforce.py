"""Forces that were read more slowly than the rows, and repeated until they were read anew.

A load cell that answers ten times a second beside an encoder read a hundred times leaves rows in
which the force stays while the platen goes on, and then jumps (a zero-order hold). Taken for
readings these rows are late by half an interval, and their noise looks correlated. Only the first
row of each repeat is a reading. A coarse converter also repeats values, where the force changes by
less than its step from row to row; but then it changes by one step at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array, Mask
from qlvbayes.io.data import Test

_FEWEST = 8  # changes of the force that show it,
_LARGE = 2.5  # of the smallest change: half of them are larger, as no converter's are that repeats,
_REPEATED = 0.6  # and as many of them follow a row that repeats the one before it
_MOVES = 0.02  # of the displacement's range, by which the platen moves about such a change at least
_AGAIN = 1.5  # times the usual repeat: in a longer one the force was read anew, and was the same


def fresh_forces(tests: Sequence[Test]) -> list[Mask | None]:
    """Return in which rows (n,) of each test of one load cell its force was read; None: in all."""
    rows = [_rows_of(test, while_moving=True) for test in tests]
    if not any(rows):
        return [None] * len(tests)
    # one load cell reads all tests: one that is too quick to show it is judged at rest as well
    rows = [
        one or _rows_of(test, while_moving=False) for one, test in zip(rows, tests, strict=True)
    ]
    return [_fresh(test.force, k) if k else None for test, k in zip(tests, rows, strict=True)]


def _rows_of(test: Test, *, while_moving: bool) -> float:
    """Return for how many rows a reading of force is repeated; 0 if that does not show."""
    change = _changes(test.force)
    if change.size < _FEWEST:
        return 0.0
    repeats, sizes = np.diff(change, prepend=0), np.abs(np.diff(test.force))[change - 1]
    usual = float(np.median(repeats))
    shown = (
        _moving(test.displacement, change, repeats) if while_moving else np.ones_like(change, bool)
    )
    if np.count_nonzero(shown) < _FEWEST or usual < 2.0:
        return 0.0
    large = shown & (sizes > _LARGE * float(sizes.min()))
    if np.count_nonzero(large) < max(_FEWEST, 0.5 * np.count_nonzero(shown)):
        return 0.0
    return usual if np.mean(repeats[large] > 1) >= _REPEATED else 0.0


def _changes(values: Array) -> NDArray[np.intp]:
    """Return the rows whose value is not that of the row before."""
    return np.flatnonzero(np.diff(values) != 0.0) + 1


def _moving(displacement: Array, change: NDArray[np.intp], repeats: NDArray[np.intp]) -> Mask:
    """Return about which changes the platen moves, also in the rows that repeat a force."""
    reach = max(int(np.median(repeats)), 2)
    least = _MOVES * float(np.ptp(displacement)) / max(change.size / 10.0, 1.0)
    before = displacement[np.maximum(change - reach, 0)]
    just, after = (
        displacement[change - 1],
        displacement[np.minimum(change + reach, displacement.size) - 1],
    )
    return np.asarray((np.abs(just - before) > least) & (np.abs(after - just) > least))


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
