"""Noise from equal cycles: what does not repeat from one cycle to the next.

Within a cycle the force is any smooth curve of each stroke, the same in all cycles but for what has
not settled yet, which is smoother along the stroke and levels off or grows steadily with the number
of the cycle. The first cycle, at whose beginning the pad was at rest, is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import BSpline

from qlvbayes.io.arrays import Array
from qlvbayes.motion.noisefloor.dwells import Dwell, MeasuredTest, dwell_of, pressed
from qlvbayes.motion.phases import MOVING, Phase

_FEWEST_CYCLES = 4  # the first is left out, and three values distinguish settling from noise
_LATE = 0.1  # of a stroke: where one turns further off its time the cycles are not equal
_UNEQUAL = 0.05  # of the stroke: the same of depths; the reading nearest a turn may miss it by half
_READ = 0.5  # of the median number of readings: a cycle with fewer does not show how deep it went
_KNOT_SAMPLES = 2.0  # readings of a cycle between two knots of the curve along a stroke
_MOST_KNOTS = 16  # along a stroke: pieces of 6 % of it, within which a soft law is a cubic
_SETTLING_DEGREE = 3  # along the stroke, of what changes from cycle to cycle


def find_cycles(tests: Sequence[MeasuredTest], phases: Sequence[Sequence[Phase]]) -> list[Dwell]:
    """Return the readings of each test of equal cycles while pressed, with their smooth curves."""
    cycles = [_repeating(test, cut) for test, cut in zip(tests, phases, strict=True)]
    return [one for one in cycles if one is not None]


def _repeating(test: MeasuredTest, phases: Sequence[Phase]) -> Dwell | None:
    turns = _turns(phases)
    if turns is None or not _equally_deep(test, turns):
        return None
    inside = pressed(test, (test.time > turns[1, 0]) & (test.time <= turns[-1, 0]))
    if inside is None:
        return None
    dwell = dwell_of(test, inside)
    return replace(dwell, curve=dwell.mean(_curve(dwell.time, turns)))


def _turns(phases: Sequence[Phase]) -> Array | None:
    """Return the times (N + 1, 2) at which each of N cycles begins and turns, and the end.

    As a clock would have them (Theil 1950; Sen 1968): when a cycle turns is known to a few samples
    only. None where there are too few cycles, or they are not equally long.
    """
    pairs = [
        (one.start, two.start)
        for one, two in pairwise(phases)
        if (one.kind, two.kind) == MOVING and one.stop == two.start
    ]
    if len(pairs) < _FEWEST_CYCLES:
        return None
    from scipy.stats import theilslopes  # here, as it takes longer to load than a first look takes

    number, times = np.arange(len(pairs)), np.array(pairs)
    lines = [theilslopes(column, number)[:2] for column in times.T]
    clock = np.column_stack([at + slope * np.arange(len(pairs) + 1) for slope, at in lines])
    shorter = np.diff(clock.ravel()).min()
    late = np.abs(times - clock[:-1]).max()
    return clock if shorter > 0.0 and late <= _LATE * shorter else None


def _equally_deep(test: MeasuredTest, turns: Array) -> bool:
    depths = [
        test.displacement[(test.time > begin) & (test.time <= end)]
        for begin, end in pairwise(turns[:, 0])
    ]
    # a user may leave out the readings of some cycles, but for one at their ends
    least = _READ * float(np.median([depth.size for depth in depths]))
    read = [depth.size > least for depth in depths]
    if sum(read[1:]) < _FEWEST_CYCLES - 1:
        return False
    ends = np.array([(x.min(), x.max()) for x, shown in zip(depths, read, strict=True) if shown])
    return bool(np.ptp(ends, axis=0).max() <= _UNEQUAL * np.ptp(ends))


def _curve(time: Array, turns: Array) -> Array:
    """Return columns (n, p) of the curve along both strokes, and of its change over the cycles."""
    cycle = np.searchsorted(turns[:, 0], time, side="left") - 1
    way_back = time > turns[cycle, 1]
    begin = np.where(way_back, turns[cycle, 1], turns[cycle, 0])
    end = np.where(way_back, turns[cycle + 1, 0], turns[cycle, 1])
    along = (time - begin) / (end - begin)
    later = cycle - 1.0
    settling = np.column_stack([later / (len(turns) - 2), np.exp(-later)])
    columns = []
    for stroke in (~way_back, way_back):
        on = np.flatnonzero(stroke)
        if on.size:
            own = _stroke(along[on], settling[on], on.size / (len(turns) - 2))
            spread = np.zeros((time.size, own.shape[1]))
            spread[on] = own
            columns.append(spread)
    return np.hstack(columns)


def _stroke(along: Array, settling: Array, samples: float) -> Array:
    """Return a cubic spline along one stroke, and a cubic for each mode of settling."""
    first, last = float(along.min()), float(along.max())
    if first == last:
        return np.ones((along.size, 1))
    count = int(np.clip(samples / _KNOT_SAMPLES, 2, _MOST_KNOTS))
    knots = np.concatenate([[first] * 3, np.linspace(first, last, count), [last] * 3])
    spline = BSpline.design_matrix(along, knots, 3).toarray()
    position = 2.0 * (along - first) / (last - first) - 1.0
    powers = legendre.legvander(position, _SETTLING_DEGREE)
    return np.hstack([spline, *(powers * power[:, None] for power in settling.T)])
