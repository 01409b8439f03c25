r"""The earlier tests of a pad, whose force may still be relaxing when a test begins.

The hereditary integral runs on through the pauses: a mode of rate v brings e^{-v pause} of its
overstress along. Only slow modes survive a pause, so that a few dozen straight lines stand for an
earlier test. A deviation e(s) of the depth from them changes a mode's overstress at the time t by
at most

.. math:: K_{max} \int v e^{-v(t - s)} |e(s)|\, ds \le K_{max} \int |e|\, ds / (e\,(t - s_1)),

with s_1 where it ends, whatever v is, and by at most K_max max|e|: so it is bounded without knowing
the rates.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from qlvbayes.io.data import Test
from qlvbayes.motion.grid import grid_times, path_at
from qlvbayes.motion.trajectory import Trajectory

REST = 3.0
"""Pauses of so many longest phases are rest.

The slowest rate that tests can determine is about one over their longest phase; of such a mode a
pause like this leaves e^-3 = 5 %, and of quicker ones less.
"""

ROUNDED = 0.01  # s, by which a declared clock may be rounded
_FAITHFUL = 2e-5  # of the stroke: bound of a straight line's error, see above; a fifth of a grid's
_MOST = 64  # points of an earlier test
_STEPS = 6  # points of a stroke, as a frame that yields makes the pad's own stroke no straight line
_STAND = 0.02  # of a test: shorter lines are not split
_AFTER_STOP = np.geomspace(
    0.004, 0.7, 8
)  # positions of points in a longer one, for the same reason
_STAYED = 0.02  # of the stroke: depths of an end and a beginning that are one


@dataclass(frozen=True)
class EarlierMotion:
    """Earlier motion of a pad: straight lines of the depth over the test's own time."""

    time: np.ndarray  # (H,): s, before the test's first sample, never decreasing
    displacement: np.ndarray  # (H,): mm
    ago: np.ndarray  # (H,): how many tests before, as in `Motion`
    stays: bool  # whether the platen stood in the last pause where the last test ended


def pause(before: Test, after: Test) -> float | None:
    """Return the seconds from one test's last sample to another's first; None if unknown."""
    if not (before.start_known and after.start_known):
        return None
    return after.start_s - _end(before)


def remembered_tests(index: int, tests: Sequence[Test], longest: float) -> list[int]:
    """Return the indices of the tests that ``tests[index]`` remembers, the last one first."""
    order = sorted(range(len(tests)), key=lambda k: tests[k].start_s)
    earlier: list[int] = []
    for before, after in reversed(list(pairwise(order[: order.index(index) + 1]))):
        between = pause(tests[before], tests[after])
        if between is None or not -ROUNDED <= between < REST * longest:
            break
        earlier.append(before)
    return earlier


def past_of(
    index: int, tests: Sequence[Test], paths: Sequence[Trajectory], longest: float
) -> EarlierMotion | None:
    """Return what ``tests[index]`` remembers, given the motions ``paths`` of all tests."""
    remembered = remembered_tests(index, tests, longest)
    if not remembered:
        return None
    test, own = tests[index], paths[index]
    zero = test.start_s - float(test.time[0])  # the clock at the test's time 0
    pieces, after = [], index
    for k, other in enumerate(remembered, start=1):
        shift = tests[other].start_s - float(tests[other].time[0]) - zero
        stays = _stays(tests[other], paths[other], tests[after], paths[after])
        time, depth = _lines(tests[other], paths[other], float(test.time[0]) - shift)
        if not stays:
            # at once: a step at the test's end, then zero until the next test begins
            until = tests[after].start_s - tests[other].start_s + float(tests[other].time[0])
            time = np.concatenate([time, [time[-1], until]])
            depth = np.concatenate([depth, [0.0, 0.0]])
        pieces.append((time + shift, depth, np.full(time.size, k)))
        after = other
    fields = (np.concatenate(parts) for parts in zip(*reversed(pieces), strict=True))
    time, depth, ago = fields
    stays = _stays(tests[remembered[0]], paths[remembered[0]], test, own)
    return EarlierMotion(np.maximum.accumulate(time), depth, ago, stays)


def _end(test: Test) -> float:
    """Return the clock (s) at a test's last sample."""
    return test.start_s + float(test.time[-1] - test.time[0])


def _stays(before: Test, path: Trajectory, after: Test, next_path: Trajectory) -> bool:
    """Return whether a test begins where the one before ended, away from zero."""
    near = _STAYED * float(np.ptp(path.displacement(path.knots)))
    end = float(path.displacement(before.time[-1:])[0])
    begin = float(next_path.displacement(after.time[:1])[0])
    return abs(end - begin) <= near < abs(end)


def _lines(test: Test, path: Trajectory, until: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and depths of a test, as few as a test that begins later needs."""
    time = grid_times(path, test.time[-1:], float(test.time[0]), curved=False)
    depth = path_at(path, time, float(test.time[0]))
    kept = _thinned(time, depth, until)
    split = _split(time[kept], depth[kept])
    return split, np.interp(split, time[kept], depth[kept])


def _split(time: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return the times of the lines' ends, and of points between where effects change the lines."""
    travel = _STEPS * np.abs(np.diff(depth)) / float(np.ptp(depth))
    times = [time]
    for begin, end, steps in zip(time[:-1], time[1:], travel, strict=True):
        if steps > 1.0:
            times.append(np.linspace(begin, end, math.ceil(steps) + 1))
        elif end - begin > _STAND * (time[-1] - time[0]):
            times.append(begin + (end - begin) * _AFTER_STOP)
    return np.unique(np.concatenate(times))


def _thinned(time: np.ndarray, depth: np.ndarray, until: float) -> np.ndarray:
    """Return the indices of the points kept: the line with the largest error is split first."""
    least = _FAITHFUL * float(np.ptp(depth))
    kept = [0, time.size - 1]
    lines = [_line(time, depth, until, 0, time.size - 1)]
    while len(kept) < _MOST and -lines[0][0] > least:
        _, low, middle, high = heapq.heappop(lines)
        kept.append(middle)
        for ends in ((low, middle), (middle, high)):
            heapq.heappush(lines, _line(time, depth, until, *ends))
    return np.sort(kept)


def _line(
    time: np.ndarray, depth: np.ndarray, until: float, low: int, high: int
) -> tuple[float, int, int, int]:
    """Return minus the bound of a straight line's error, and its first, worst and last index."""
    inner = slice(low, high + 1)
    straight = np.interp(time[inner], [time[low], time[high]], [depth[low], depth[high]])
    error = np.abs(depth[inner] - straight)
    bound = float(error.max())
    if (gap := until - float(time[high])) > 0.0:
        bound = min(bound, float(np.trapezoid(error, time[inner])) / (math.e * gap))
    return -bound, low, low + int(error.argmax()), high
