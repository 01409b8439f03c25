"""Errors of the rig's encoder and load cell, and the thinning of its logger."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from math import inf

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.checks import InputError

ENCODER_STEP = 0.001
"""Resolution of the paper's encoder, mm."""


@dataclass(frozen=True)
class Noise:
    """Load-cell noise: white plus a stationary Ornstein-Uhlenbeck process.

    cov(s, t) = white^2 [s = t] + correlated^2 e^{-|s - t| / correlation_time}
    """

    # white, correlated: standard deviations, N
    white: float = 0.006
    correlated: float = 0.008
    correlation_time: float = 0.5  # s

    def __post_init__(self) -> None:
        if not (0 <= self.white < inf and 0 <= self.correlated < inf):
            raise InputError(f"a noise's standard deviation must be at least 0, not {self}")
        if not 0 < self.correlation_time < inf:
            raise InputError(f"a noise's correlation time must be above 0, not {self}")

    def draw(self, times: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw one realisation (N) at ascending `times` (s), exact for any spacing."""
        white, kicks = rng.standard_normal((2, times.size))
        return self.white * white + self.correlated * self._walk(times, kicks)

    def _walk(self, times: NDArray[np.float64], kicks: NDArray[np.float64]) -> NDArray[np.float64]:
        """Walk a unit Ornstein-Uhlenbeck process, stationary as its first value is a kick."""
        memory = np.exp(-np.diff(times) / self.correlation_time)
        spread = np.sqrt(-np.expm1(-2 * np.diff(times) / self.correlation_time))
        kicks = np.append(kicks[:1], spread * kicks[1:])
        steps: Iterator[float] = iter(memory.tolist())
        walk = accumulate(kicks.tolist(), lambda x, kick: next(steps) * x + kick)
        return np.fromiter(walk, np.float64, count=times.size)


NOISES = {
    "correlated": Noise(),
    "white": Noise(white=0.01, correlated=0.0),
    "none": Noise(white=0.0, correlated=0.0),
}
"""Kinds of noise by name; the first two have the same total of 0.01 N."""


def encode(displacement: NDArray[np.float64], step: float = ENCODER_STEP) -> NDArray[np.float64]:
    """Return the displacement (mm) as an encoder with resolution `step` (mm) reads it."""
    return np.round(displacement / step) * step + 0.0


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
