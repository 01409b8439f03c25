r"""Motions as few points: the times at which a test's is tabulated, and the earlier tests of a pad.

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

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Test
from qlvbayes.motion.trajectory import Trajectory

REST = 3.0
"""Pauses of so many longest phases are rest.

The slowest rate that tests can determine is about one over their longest phase; of such a mode a
pause like this leaves e^-3 = 5 %, and of quicker ones less.
"""

ROUNDED = 0.01  # s, by which a declared clock may be rounded
_CHORD = 1e-4  # of the stroke: how far the grid's straight lines may be from the motion,
_FINEST = 3e-6  # and the least that very quiet noise asks for
_CURVED = 10.0  # times that, where the curvature between the points is stored too: on a sine half
# as many points, and a tenth of the error of the force that straight lines make (2e-6 of its peak)
_HALVINGS = 40  # of a stretch in which the displacement passes zero: to 1e-12 of it
_FAITHFUL = 2e-5  # of the stroke: bound of a straight line's error, see above; a fifth of a grid's
_MOST = 64  # points of an earlier test
_STEPS = 6  # points of a stroke, as a frame that yields makes the pad's own stroke no straight line
_STAND = 0.02  # of a test: shorter lines are not split
_AFTER_STOP = np.geomspace(0.004, 0.7, 8)  # points in a longer one, for the same reason
_STAYED = 0.02  # of the stroke: depths of an end and a beginning that are one


def grid_times(
    trajectory: Trajectory,
    nodes: Array,
    first: float,
    *,
    chord: float = np.inf,
    begun: bool = True,
    curved: bool = True,
) -> Array:
    """Return the nodes, the beginning, the kinks, and as many points between as accuracy needs.

    The moments at which the displacement passes zero are among them: there a platen touches.
    begun: whether a record that begins in motion was at zero displacement before.
    """
    stroke = np.ptp(trajectory.displacement(trajectory.knots))
    tolerance = max(0.25 * trajectory.resolution, _CHORD * stroke)
    tolerance = min(tolerance, max(chord, _FINEST * stroke)) * (_CURVED if curved else 1.0)
    points = trajectory.knots[(trajectory.knots > first) & (trajectory.knots < nodes[-1])]
    depth, speed = float(trajectory.displacement(first)), float(trajectory.velocity(first))
    approach = [first - depth / speed] if begun and depth * speed > 0.0 else []
    points = np.unique(np.concatenate([approach, [first], points, nodes]))
    points = np.unique(np.concatenate([points, _crossings(trajectory, points[points >= first])]))
    bend = np.abs(trajectory.acceleration(0.5 * (points[1:] + points[:-1])))
    pieces = np.ceil(np.diff(points) * np.sqrt(bend / (8.0 * tolerance))).astype(int)
    extra = [
        np.linspace(points[k], points[k + 1], pieces[k] + 1)[1:-1]
        for k in np.flatnonzero(pieces > 1)
    ]
    return np.unique(np.concatenate([points, *extra]))


def _crossings(trajectory: Trajectory, points: Array) -> Array:
    """Return the times (s) at which the displacement passes zero between points (N,)."""
    depth = trajectory.displacement(points)
    rows = np.flatnonzero(depth[:-1] * depth[1:] < 0.0)
    low, high, below = points[rows], points[rows + 1], depth[rows]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        before = trajectory.displacement(middle) * below > 0.0
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return 0.5 * (low + high)


def path_at(trajectory: Trajectory, grid: Array, first: float) -> Array:
    """Return the displacement on the grid; the approach before the first sample begins at zero."""
    return np.where(grid < first, 0.0, trajectory.displacement(grid))


@dataclass(frozen=True)
class EarlierMotion:
    """Earlier motion of a pad: straight lines of the depth over the test's own time."""

    time: Array  # (H,): s, before the test's first sample, never decreasing
    displacement: Array  # (H,): mm
    ago: Array  # (H,): how many tests before, as in `Motion`
    stays: bool  # whether the platen stood in the last pause where the last test ended


def pause(before: Test, after: Test) -> float | None:
    """Return the seconds from one test's last sample to another's first; None if unknown."""
    if not (before.start_known and after.start_known):
        return None
    return after.start_s - before.start_s - float(before.time[-1] - before.time[0])


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
    own = tests[index]
    zero = own.start_s - float(own.time[0])  # the clock at the test's time 0
    pieces, stays = [], []
    for k, (after, at) in enumerate(pairwise([index, *remembered]), start=1):
        test = tests[at]
        shift = test.start_s - float(test.time[0]) - zero
        stays.append(_stays(test, paths[at], tests[after], paths[after]))
        time, depth = _lines(test, paths[at], float(own.time[0]) - shift)
        if not stays[-1]:  # at once: a step at its end, then zero until the next test begins
            until = tests[after].start_s - test.start_s + float(test.time[0])
            time, depth = np.append(time, [time[-1], until]), np.append(depth, [0.0, 0.0])
        pieces.append((time + shift, depth, np.full(time.size, k)))
    time, depth, ago = (np.concatenate(parts) for parts in zip(*reversed(pieces), strict=True))
    return EarlierMotion(np.maximum.accumulate(time), depth, ago, stays[0])


def _stays(before: Test, path: Trajectory, after: Test, next_path: Trajectory) -> bool:
    """Return whether a test begins where the one before ended, away from zero."""
    near = _STAYED * float(np.ptp(path.displacement(path.knots)))
    end = float(path.displacement(before.time[-1]))
    return abs(end - float(next_path.displacement(after.time[0]))) <= near < abs(end)


def _lines(test: Test, path: Trajectory, until: float) -> tuple[Array, Array]:
    """Return times and depths of a test, as few as one that begins later needs.

    Between the lines' ends there are points where effects change the lines.
    """
    first = float(test.time[0])
    time = grid_times(path, test.time[-1:], first, curved=False)
    depth = path_at(path, time, first)
    kept = _thinned(time, depth, until)
    time, depth = time[kept], depth[kept]
    travel = _STEPS * np.abs(np.diff(depth)) / float(np.ptp(depth))
    times = [time]
    for begin, end, steps in zip(time[:-1], time[1:], travel, strict=True):
        if steps > 1.0:
            times.append(np.linspace(begin, end, math.ceil(steps) + 1))
        elif end - begin > _STAND * (time[-1] - time[0]):
            times.append(begin + (end - begin) * _AFTER_STOP)
    split = np.unique(np.concatenate(times))
    return split, np.interp(split, time, depth)


def _thinned(time: Array, depth: Array, until: float) -> Array:
    """Return the indices of the points kept: the line with the largest error is split first."""

    def line(low: int, high: int) -> tuple[float, int, int, int]:
        """Return minus the bound of a line's error, and its first, worst and last index."""
        inner = slice(low, high + 1)
        ends = [low, high]
        error = np.abs(depth[inner] - np.interp(time[inner], time[ends], depth[ends]))
        bound = float(error.max())
        if (gap := until - float(time[high])) > 0.0:
            bound = min(bound, float(np.trapezoid(error, time[inner])) / (math.e * gap))
        return -bound, low, low + int(error.argmax()), high

    least = _FAITHFUL * float(np.ptp(depth))
    kept = [0, time.size - 1]
    lines = [line(0, time.size - 1)]
    while len(kept) < _MOST and -lines[0][0] > least:
        _, low, middle, high = heapq.heappop(lines)
        kept.append(middle)
        for ends in ((low, middle), (middle, high)):
            heapq.heappush(lines, line(*ends))
    return np.sort(kept)
