r"""Outlying readings of one channel: those that differ from their neighbours on both sides.

A run of k readings is held against the sound ones before and after it, at a and b: it is outlying
if each of its values lies beyond both by more than

.. math:: \max(12 k^{1/2} s,\; 4 q,\; 4 |\Delta x|_{med},\; |b - a|,\; 0.01\, range),

s being the median distance of a reading from the line through its two neighbours (those nearby, and
all as far apart in time), q the step of a digitised channel. A step is as large as the difference
of its sides, a turn as large as the changes nearby, noise as s.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from qlvbayes.io.arrays import Array
from qlvbayes.motion.sensor import encoder_step

Run = tuple[int, int]  # readings from the first to before the last index
Rows = NDArray[np.intp]

_LONGEST = 8  # readings in a row that differ among each other; zeros may be more
FEWEST = 12  # readings of which anything can be said
_PASSES = 4  # over the readings that are left
_NEARBY = 61  # readings whose median gives the noise here
_BEYOND = 12.0  # of these medians: 10 sds of white noise
_CHANGES = 4.0  # of the median change from reading to reading, and of a digitised channel's steps
_LEAST = 0.01  # of the channel's range: less does no harm
_NOTICED = 8.0  # times the noise: a change of force that would surely be seen
_STEP_READINGS = 20_000  # that show the step of a digitised channel


def outlying(time: Array, signal: Array) -> NDArray[np.bool_]:
    """Return a mask of the readings (n,) that lie far outside those before and after them."""
    if signal.size < FEWEST:
        return np.zeros(signal.size, dtype=bool)
    return mask_of(outlying_runs(time, signal, ChangeScale.of(time, signal)), signal.size)


@dataclass(frozen=True)
class ChangeScale:
    """Size of the changes from reading to reading in one channel."""

    deviation: Array  # (n,) median distance of a reading from the line through its neighbours
    change: Array  # (n,) median change nearby
    step: float  # of a digitised channel, 0 where none shows
    span: float  # its range

    @classmethod
    def of(cls, time: Array, signal: Array) -> ChangeScale:
        """Return the scale of one channel, which few bad readings do not change."""
        off, gaps = _off_line(time, signal), np.diff(time)
        # as far off as those with similar intervals to their neighbours are
        gap = np.minimum(gaps[1:], gaps[:-1])
        order = np.argsort(gap, kind="stable")
        root, alike = np.sqrt(gap[order]), np.empty_like(off)
        alike[order] = root * _median(off[order] / root)
        low, high = np.quantile(signal, [0.005, 0.995])
        change = np.abs(np.diff(signal))
        few = signal[:_STEP_READINGS]
        moves = change[: few.size - 1][change[: few.size - 1] > 0.0]
        step = encoder_step(few) or float(moves.min(initial=np.inf))  # bad ones are no multiples
        return cls(
            np.pad(np.maximum(_median(off), alike), 1, mode="edge"),
            np.pad(_median(change), (0, 1), mode="edge"),
            step if np.isfinite(step) else 0.0,
            # the range of a force that is held is rounding
            max(float(high - low), 1e-5 * float(np.max(np.abs(signal)))),
        )

    def at(self, rows: Rows) -> ChangeScale:
        """Return the scale of some of the readings."""
        return replace(self, deviation=self.deviation[rows], change=self.change[rows])

    def least(self, first: Rows | int, length: int, sides: Array | float) -> Array:
        """Return how far runs must lie outside their neighbours, which differ by ``sides``."""
        at = np.minimum(np.asarray(first) + length // 2, self.deviation.size - 1)
        noise = _BEYOND * np.sqrt(min(length, _LONGEST)) * self.deviation[at]
        coarse = _CHANGES * np.maximum(self.change[at], self.step)
        return np.maximum(np.maximum(noise, coarse), np.maximum(sides, _LEAST * self.span))

    def noise(self, at: int) -> float:
        """Return a change that is surely none of noise and step."""
        return _NOTICED * float(self.deviation[at]) + self.step


def outlying_runs(time: Array, signal: Array, scale: ChangeScale) -> list[Run]:
    """Return the outlying runs, each much farther off than its neighbours from each other."""
    mask, sound = np.zeros(signal.size, dtype=bool), np.arange(signal.size)
    for _ in range(_PASSES):
        runs = _one_pass(signal[sound], scale.at(sound))
        for run in runs:
            mask[sound[slice(*run)]] = True
        sound = np.flatnonzero(~mask)
        if not runs or sound.size < FEWEST:
            break
    if not mask.any() or sound.size < FEWEST:
        return []
    rough, alone = _off_line(time[sound], signal[sound]), []
    for first, stop in runs_of(mask):
        at = int(np.searchsorted(sound, first)) - 1  # of the last sound reading before it
        off = distance(signal[first:stop], *signal[sound[[at, at + 1]]])
        if off.min() > 3.0 * rough[max(at - 6, 0) : at + 6].max(initial=0.0):
            alone.append((first, stop))
    return alone


def _one_pass(signal: Array, scale: ChangeScale) -> list[Run]:
    """Return the outlying runs, from the shortest on, that the nearest sound readings confirm."""
    mask = np.zeros(signal.size, dtype=bool)
    for run in _candidates(signal, scale):
        if not mask[slice(*run)].any():
            mask[slice(*run)] = True
    confirmed: list[Run] = []
    for first, stop in runs_of(mask):
        before, after = signal[first - 1], signal[stop]
        bad = distance(signal[first:stop], before, after) > scale.least(
            first, 1, abs(after - before)
        )
        confirmed += [(first + a, first + b) for a, b in runs_of(bad)]
    return confirmed


def _candidates(signal: Array, scale: ChangeScale) -> Iterator[Run]:
    """Yield the runs that lie outside the readings before and after them, also long ones of 0."""
    for length in range(1, min(_LONGEST, signal.size - 2) + 1):
        starts = np.flatnonzero(np.abs(np.diff(signal[:-length])) > _LEAST * scale.span)
        values = signal[starts[:, None] + np.arange(1, length + 1)]
        before, after = signal[starts], signal[starts + length + 1]
        off = distance(values, before[:, None], after[:, None]).min(axis=1, initial=np.inf)
        far = off > scale.least(starts + 1, length, np.abs(after - before))
        for at in (starts[far] + 1).tolist():
            yield at, at + length
    for first, stop in equal_runs(signal, _LONGEST + 1):
        if signal[first] == 0.0 and first > 0 and stop < signal.size:
            before, after = signal[[first - 1, stop]]
            least = scale.least(first, stop - first, abs(after - before))
            if distance(signal[first], before, after) > least:
                yield first, stop


def runs_at_ends(signal: Array, scale: ChangeScale) -> Iterator[Run]:
    """Yield outlying runs at the record's ends, which have neighbours on one side only."""
    for ahead in (signal, signal[::-1]):
        for stop in (1, 2, 3):
            one, other = float(ahead[stop]), float(ahead[stop + 1])
            first = 0 if ahead is signal else signal.size - stop
            if distance(ahead[:stop], one, other).min() > scale.least(
                first, stop, abs(one - other)
            ):
                yield first, first + stop
                break


def runs_of(mask: NDArray[np.bool_]) -> list[Run]:
    """Return the runs [first, stop) of masked readings."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def mask_of(runs: Iterable[Run], size: int) -> NDArray[np.bool_]:
    """Return which of ``size`` readings are in any of the runs."""
    mask = np.zeros(size, dtype=bool)
    for run in runs:
        mask[slice(*run)] = True
    return mask


def equal_runs(signal: Array, least: int) -> list[Run]:
    """Return the runs of at least this many readings that repeat one value."""
    edges = np.flatnonzero(np.diff(signal) != 0.0) + 1
    edges = np.concatenate([[0], edges, [signal.size]])
    long = np.flatnonzero(np.diff(edges) >= least)
    return [(int(edges[k]), int(edges[k + 1])) for k in long]


def distance(values: Array, one: float | Array, other: float | Array) -> Array:
    """Return how far values lie outside the interval between two levels."""
    low, high = np.minimum(one, other), np.maximum(one, other)
    return np.maximum(np.maximum(values - high, low - values), 0.0)


def _off_line(time: Array, signal: Array) -> Array:
    """Return the distance (n - 2,) of each inner reading from the line through its neighbours."""
    weight = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    return np.abs(signal[1:-1] - signal[:-2] - weight * (signal[2:] - signal[:-2]))


def _median(values: Array) -> Array:
    return np.asarray(median_filter(values, size=min(_NEARBY, values.size), mode="reflect"))
