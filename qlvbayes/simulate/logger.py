"""A data logger's thinning: which samples of a long test are kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError

_STILL_S = 0.5  # a standstill at least this long is a hold
_FIRST_S = 0.02  # growth of the intervals: dense for this long after motion or hold begins
_BURSTS = 3  # of neighbouring samples, in a phase that is thinned
_BURST_ROWS = 6  # samples at the full rate, enough to distinguish white from correlated noise
_LEAST_ROWS = 8  # a phase


def thin(
    time: NDArray[np.float64], displacement: NDArray[np.float64], max_rows: int
) -> NDArray[np.intp]:
    """Choose at most `max_rows` samples, the first and last among them; give their indices."""
    if time.size <= max_rows:
        return np.arange(time.size)
    edges = _edges(time, displacement)
    if max_rows < _LEAST_ROWS * (edges.size - 1) + 1:
        raise InputError(
            f"{max_rows} rows are too few for {edges.size - 1} motions and holds",
            remedy=f"keep at least {_LEAST_ROWS * (edges.size - 1) + 1}",
        )
    shares = _shares(np.diff(edges), max_rows - 1)
    kept = [np.array([time.size - 1])]
    for start, stop, rows in zip(edges[:-1], edges[1:], shares, strict=True):
        phase = slice(start, stop)
        kept.append(start + _in_phase(time[phase], displacement[phase], int(rows)))
    return np.unique(np.concatenate(kept))


def _edges(time: NDArray[np.float64], displacement: NDArray[np.float64]) -> NDArray[np.intp]:
    """Find where motions and holds begin; the last edge is the number of samples."""
    changes = np.flatnonzero(np.diff(displacement))
    # Sentinels at both ends: a standstill there counts if it is long enough, like any other.
    before = np.concatenate([[0], changes + 1])
    after = np.concatenate([changes, [time.size - 1]])
    still = time[after] - time[before] >= _STILL_S
    inner = np.concatenate([before[still], after[still]])
    inner = inner[(inner > 0) & (inner < time.size - 1)]
    return np.unique(np.concatenate([[0], inner, [time.size]]))


def _shares(sizes: NDArray[np.intp], rows: int) -> NDArray[np.intp]:
    """Return the rows of each phase: equal; what a short phase cannot use goes to longer ones."""
    shares = np.zeros_like(sizes)
    for rank, phase in enumerate(np.argsort(sizes, kind="stable")):
        shares[phase] = min(sizes[phase], rows // (sizes.size - rank))
        rows -= shares[phase]
    return shares


def _in_phase(
    time: NDArray[np.float64], displacement: NDArray[np.float64], rows: int
) -> NDArray[np.intp]:
    """Choose samples of one phase at equal steps of a clock that runs fast where much happens."""
    if rows >= time.size:
        return np.arange(time.size)
    clock = np.log1p((time - time[0]) / _FIRST_S)
    clock /= clock[-1]
    travel = np.cumsum(np.abs(np.diff(displacement, prepend=displacement[0])))
    if travel[-1] > 0:
        return _at_equal_steps(0.5 * (clock + travel / travel[-1]), rows)
    bursts = _bursts(time.size, rows)
    return np.concatenate([_at_equal_steps(clock, rows - bursts.size), bursts])


def _at_equal_steps(clock: NDArray[np.float64], rows: int) -> NDArray[np.intp]:
    ticks = np.linspace(0.0, 1.0, rows)
    return np.unique(np.minimum(np.searchsorted(clock, ticks), clock.size - 1))


def _bursts(size: int, rows: int) -> NDArray[np.intp]:
    """Place runs of consecutive samples evenly in a hold, at most half of its rows."""
    count = min(_BURSTS, rows // (2 * _BURST_ROWS))
    starts = ((np.arange(count) + 0.5) / max(count, 1) * (size - _BURST_ROWS)).astype(np.intp)
    return (starts[:, None] + np.arange(_BURST_ROWS)).ravel()
