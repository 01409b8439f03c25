r"""Outlying readings of one channel: those that differ from their neighbours on both sides.

A run of k readings is held against the sound ones before and after it, at a and b: it is outlying
if each of its values lies beyond both by more than

.. math:: \max(12 k^{1/2} s,\; 4 q,\; 4 |\Delta x|_{med},\; |b - a|,\; 0.01\, range),

s being the median distance of a reading from the line through its two neighbours (those nearby, and
all as far apart in time), q the step of a digitised channel. A step is as large as the difference
of its sides, a turn as large as the changes nearby, noise as s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from qlvbayes.io.arrays import Array
from qlvbayes.motion.sensor import encoder_step

Run = tuple[int, int]

LONGEST = 8  # readings in a row that differ among each other; zeros may be more
_EITHER_SIDE = 6  # readings on either side that must be smooth without it,
_ROUGHER = 3.0  # times less off a line than the run
_PASSES = 4  # over the readings that are left
_AT_ENDS = 3  # readings at either end of the record
_NEARBY = 61  # readings whose median gives the noise here
_BEYOND = 12.0  # of these medians: 10 sds of white noise
_CHANGES = 4.0  # of the median change from reading to reading: how sharp a movement may turn
_STEPS = 4.0  # of a digitised channel
_SIDES = 1.0  # of the difference between both sides: what lies between two levels is their step
_LEAST = 0.01  # of the channel's range: less does no harm
_ROUNDING = 1e-5  # of the largest value: smaller ranges are no signal's
_STEP_READINGS = 20_000  # that show the step of a digitised channel
FEWEST = 12  # readings of which anything can be said


@dataclass(frozen=True)
class ChangeScale:
    """Size of the changes from reading to reading in one channel."""

    deviation: Array  # (n,) median distance of a reading from the line through its neighbours
    change: Array  # (n,) median change nearby
    step: float  # of a digitised channel, 0 where none shows
    span: float  # its range

    def at(self, indices: NDArray[np.intp]) -> ChangeScale:
        """Return the scale of some of the readings."""
        return replace(self, deviation=self.deviation[indices], change=self.change[indices])

    def least(self, run: Run, sides: float) -> float:
        """Return how far a run must lie outside its neighbours, which differ by ``sides``."""
        first, stop = run
        at = min((first + stop) // 2, self.deviation.size - 1)
        return max(
            _BEYOND * float(np.sqrt(min(stop - first, LONGEST)) * self.deviation[at]),
            _CHANGES * float(self.change[at]),
            _STEPS * self.step,
            _SIDES * sides,
            _LEAST * self.span,
        )


def scale_of(time: Array, signal: Array) -> ChangeScale:
    """Return the scale of one channel, which few bad readings do not change."""
    off = _off_line(time, signal)
    change = np.abs(np.diff(signal))
    near = _median(off)
    gaps = np.diff(time)
    alike = _of_equal_gaps(np.minimum(gaps[1:], gaps[:-1]), off)
    low, high = np.quantile(signal, [0.005, 0.995])
    # the range of a force that is held is rounding
    span = max(float(high - low), _ROUNDING * float(np.max(np.abs(signal))))
    return ChangeScale(
        np.pad(np.maximum(near, alike), 1, mode="edge"),
        np.pad(_median(change), (0, 1), mode="edge"),
        _step(signal),
        span,
    )


def outlying(time: Array, signal: Array) -> NDArray[np.bool_]:
    """Return a mask of the readings (n,) that lie far outside those before and after them."""
    mask = np.zeros(signal.size, dtype=bool)
    if signal.size >= FEWEST:
        for first, stop in outlying_runs(time, signal, scale_of(time, signal)):
            mask[first:stop] = True
    return mask


def outlying_runs(time: Array, signal: Array, scale: ChangeScale) -> list[Run]:
    """Return the runs [first, stop) of outlying readings; no two of them touch."""
    mask = np.zeros(signal.size, dtype=bool)
    sound = np.arange(signal.size)
    for _ in range(_PASSES):
        runs = _one_pass(signal[sound], scale.at(sound))
        if not runs:
            break
        for first, stop in runs:
            mask[sound[first:stop]] = True
        sound = np.flatnonzero(~mask)
    return _alone(time, signal, mask)


def _alone(time: Array, signal: Array, mask: NDArray[np.bool_]) -> list[Run]:
    """Return the runs that lie much farther from their neighbours than these from each other."""
    runs, sound = runs_of(mask), np.flatnonzero(~mask)
    if not runs or sound.size < FEWEST:
        return []
    rough = _off_line(time[sound], signal[sound])
    single = []
    for first, stop in runs:
        at = int(np.searchsorted(sound, first))  # of the first sound reading after it
        before, after = float(signal[sound[at - 1]]), float(signal[sound[at]])
        near = rough[max(at - 1 - _EITHER_SIDE, 0) : at - 1 + _EITHER_SIDE]
        least = float(distance(signal[first:stop], before, after).min())
        if least > _ROUGHER * float(near.max(initial=0.0)):
            single.append((first, stop))
    return single


def runs_at_ends(signal: Array, scale: ChangeScale) -> list[Run]:
    """Return outlying runs at the record's ends, which have neighbours on one side only."""
    runs = []
    for ahead in (signal, signal[::-1]):
        for stop in range(1, _AT_ENDS + 1):
            sides = abs(float(ahead[stop] - ahead[stop + 1]))
            off = distance(ahead[:stop], float(ahead[stop]), float(ahead[stop + 1]))
            run = (0, stop) if ahead is signal else (signal.size - stop, signal.size)
            if off.min() > scale.least(run, sides):
                runs.append(run)
                break
    return runs


def runs_of(mask: NDArray[np.bool_]) -> list[Run]:
    """Return the runs [first, stop) of masked readings."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def _one_pass(signal: Array, scale: ChangeScale) -> list[Run]:
    mask = np.zeros(signal.size, dtype=bool)
    for length in range(1, LONGEST + 1):
        for run in _of_length(signal, scale, length, mask):
            mask[run[0] : run[1]] = True
    for run in equal_runs(signal, LONGEST + 1):
        zeros = not signal[run[0]]
        if zeros and not mask[run[0] : run[1]].any() and _beyond(signal, scale, run):
            mask[run[0] : run[1]] = True
    return _confirmed(signal, scale, mask)


def equal_runs(signal: Array, least: int) -> list[Run]:
    """Return the runs [first, stop) of at least this many readings that repeat one value."""
    edges = np.flatnonzero(np.diff(signal) != 0.0) + 1
    edges = np.concatenate([[0], edges, [signal.size]])
    long = np.flatnonzero(np.diff(edges) >= least)
    return [(int(edges[k]), int(edges[k + 1])) for k in long]


def distance(values: Array, one: float, other: float) -> Array:
    """Return how far values lie outside the interval between two levels."""
    low, high = min(one, other), max(one, other)
    return np.maximum(np.maximum(values - high, low - values), 0.0)


def _off_line(time: Array, signal: Array) -> Array:
    """Return the distance (n - 2,) of each inner reading from the line through its neighbours."""
    weight = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    line = signal[:-2] + weight * (signal[2:] - signal[:-2])
    return np.abs(signal[1:-1] - line)


def _median(values: Array) -> Array:
    size = min(_NEARBY, values.size)
    return np.asarray(median_filter(values, size=size, mode="reflect"))


def _of_equal_gaps(gaps: Array, off: Array) -> Array:
    """Return the median distance of readings with similar intervals to their neighbours."""
    order = np.argsort(gaps, kind="stable")
    root = np.sqrt(gaps[order])
    scales = np.empty_like(off)
    scales[order] = root * _median(off[order] / root)
    return scales


def _step(signal: Array) -> float:
    """Return the step of a digitised channel, of which bad readings need not be multiples."""
    few = signal[:_STEP_READINGS]
    step = encoder_step(few)
    if step > 0.0:
        return step
    changes = np.abs(np.diff(few))
    changes = changes[changes > 0.0]
    return float(changes.min()) if changes.size else 0.0


def _of_length(
    signal: Array, scale: ChangeScale, length: int, mask: NDArray[np.bool_]
) -> list[Run]:
    """Return the outlying runs of one length that do not overlap known ones."""
    if signal.size < length + 2:
        return []
    # most readings are too near the one before them to begin a run: the others are few
    starts = np.flatnonzero(np.abs(np.diff(signal[:-length])) > _LEAST * scale.span)
    before, after = signal[starts], signal[starts + length + 1]
    low, high = np.minimum(before, after), np.maximum(before, after)
    beyond = np.full(low.size, np.inf)
    for k in range(1, length + 1):
        value = signal[starts + k]
        beyond = np.minimum(beyond, np.maximum(value - high, low - value))
    # of most of these their own noise disposes: one by one they would take seconds
    noise = scale.deviation[starts + 1 + length // 2]
    least = np.maximum(_LEAST * scale.span, _BEYOND * np.sqrt(length) * noise)
    likely = beyond > np.maximum(least, high - low)
    runs: list[Run] = []
    for at in (starts[likely] + 1).tolist():
        run = (at, at + length)
        if not mask[at : at + length].any() and _beyond(signal, scale, run):
            runs.append(run)
    return runs


def _beyond(signal: Array, scale: ChangeScale, run: Run) -> bool:
    first, stop = run
    if first == 0 or stop == signal.size:
        return False
    before, after = float(signal[first - 1]), float(signal[stop])
    least = float(distance(signal[first:stop], before, after).min())
    return least > scale.least(run, abs(after - before))


def _confirmed(signal: Array, scale: ChangeScale, mask: NDArray[np.bool_]) -> list[Run]:
    """Return the runs of masked readings that the nearest sound ones do not confirm as sound."""
    confirmed: list[Run] = []
    for first, stop in runs_of(mask):
        if first == 0 or stop == signal.size:
            continue
        before, after = float(signal[first - 1]), float(signal[stop])
        least = scale.least((first, first + 1), abs(after - before))
        bad = distance(signal[first:stop], before, after) > least
        confirmed += [(first + a, first + b) for a, b in runs_of(bad)]
    return confirmed
