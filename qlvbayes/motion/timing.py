r"""Force errors from uncertain times: of the readings, and of the kinks of the motion.

A reading at a distance d from a kink of the motion, of which both together are known to within
sigma, lies beyond it with the probability p = Phi(-d / sigma). Where the force jumps by Delta F
there, whatever made it jump, the reading has the additional variance

.. math:: p (1 - p)\, \Delta F^2

and a clock that is known to within sigma_c adds (sigma_c dF/dt)^2 to every reading. Jump and slope
are the record's own: how far a reading is off the line through the readings on either side, beyond
what their noise makes of it, and the slope of that line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from qlvbayes.io.arrays import Array
from qlvbayes.motion.trajectory import Trajectory

_EXACT = 1e-3
"""Of a sampling interval: no kink is known better, whatever the record says."""
_OFF_THE_LINE = 6.0
"""Variance of twice the distance of a reading to the line through its neighbours, over its own."""
_UNRESOLVED = 12.0**-0.5
"""Sd of a moment that may lie anywhere within one sampling interval, over that interval."""


def kink_doubt(time: Array, trajectory: Trajectory) -> Array:
    """Return (p (1 - p))^1/2 of each reading at times (n,) in s, by its nearest kink."""
    read = trajectory.read_times(time)
    kinks, sds = trajectory.kinks, kink_sds(read, trajectory)
    if trajectory.start_velocity[0] or trajectory.start_acceleration[0]:  # moves from the start
        kinks = np.concatenate([trajectory.knots[:1], kinks])
        sds = np.concatenate([_UNRESOLVED * np.diff(read)[:1], sds])
    if not kinks.size:
        return np.zeros(time.shape)
    nearest = _nearest(kinks, time)
    beyond = ndtr(-np.abs(time - kinks[nearest]) / sds[nearest])
    return np.asarray(np.sqrt(beyond * (1.0 - beyond)))


def _nearest(kinks: Array, at: Array) -> NDArray[np.intp]:
    """Return the index (n,) of the nearest of the sorted kinks (k,) to each time."""
    after = np.clip(np.searchsorted(kinks, at), 1, max(kinks.size - 1, 1))
    sides = np.stack([after - 1, np.minimum(after, kinks.size - 1)])
    nearer = np.argmin(np.abs(kinks[sides] - at), axis=0)
    return np.asarray(np.take_along_axis(sides, nearer[None], axis=0)[0])


def kink_sds(time: Array, trajectory: Trajectory) -> Array:
    """Return the sd (k,) in s of the time of each kink relative to the readings' clock."""
    interval = _intervals(trajectory.kinks, time)
    width = np.where(trajectory.speed_jumps > 0.0, _UNRESOLVED, _EXACT) * interval
    return np.asarray(np.sqrt(width**2 + trajectory.kink_sd**2 + trajectory.clock_sd**2))


def _intervals(at: Array, time: Array) -> Array:
    """Return the shorter (k,) of the sampling intervals (s) next to some times."""
    step = np.diff(time)
    after = np.clip(np.searchsorted(time, at), 1, step.size)
    return np.asarray(np.minimum(step[after - 1], step[np.minimum(after, step.size - 1)]))


def timing_sd(
    time: Array,
    force: Array,
    begin: NDArray[np.intp],
    trajectory: Trajectory,
    white: float,
    rows: NDArray[np.intp] | None = None,
) -> Array:
    """Return the sd (B,) in N of block means that uncertain times cause."""
    kink = kink_doubt(time, trajectory) * _jumps(time, force, white)
    clock = (trajectory.clock_sd * np.gradient(force, time)) ** 2
    if rows is not None:
        kink, clock = kink[rows], clock[rows]
    count = np.diff(np.append(begin, kink.size))
    kinks, clocks = np.add.reduceat(kink, begin), np.add.reduceat(clock, begin)
    return np.asarray(np.sqrt(kinks**2 + clocks) / count)


def _jumps(time: Array, force: Array, white: float) -> Array:
    """Return the jump (n,) of the force (N) to one side of each reading."""
    jumps = np.abs(np.diff(force, append=force[-1:]))  # at the ends the change to the next one
    if time.size > 2:
        step = np.diff(time)
        line = (force[:-2] * step[1:] + force[2:] * step[:-1]) / (step[1:] + step[:-1])
        jumps[1:-1] = 2.0 * np.abs(force[1:-1] - line)
        jumps[-1] = abs(force[-1] - force[-2])
    return np.asarray(np.sqrt(np.maximum(jumps**2 - _OFF_THE_LINE * white**2, 0.0)))


def off_kinks(centre: Array, half: Array, time: Array, trajectory: Trajectory) -> Array:
    """Return half the distance (B,) in s of a block's two nodes, neither of them at a kink."""
    kinks = trajectory.kinks
    if not kinks.size:
        return half
    least = _EXACT * _intervals(centre, time)
    apart = np.abs(centre - kinks[_nearest(kinks, centre)])
    inside = np.minimum(centre - time[0], time[-1] - centre) > least
    return np.where((apart < least) & inside, np.maximum(half, least), half)
