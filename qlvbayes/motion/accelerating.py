"""Where a platen changes its speed, and the mass that the force there shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Test
from qlvbayes.motion.trajectory import Trajectory

_MATERIAL = 0.1  # of the top speed, that an acceleration of one sign changes the speed by
_SHARP = 0.5  # of that acceleration's largest, by which it changes within a few readings
_DOUBT = 3.0  # sds of the time of a kink
_TINY = np.finfo(float).tiny
_FEWEST = 12  # readings, from whose changes a mass is found


def speed_changes(test: Test, trajectory: Trajectory, width: int) -> NDArray[np.bool_]:
    """Return which readings (n,) lie within ``width`` readings of a sharp change of acceleration.

    A start, the end of a speeding up, braking and a stop are such changes, and a jump of the speed;
    an acceleration counts from a tenth of the top speed on, as a fitted motion also ripples.
    """
    knots, time = trajectory.knots, test.time
    inside = 1e-6 * np.diff(knots)
    begin, end = knots[:-1] + inside, knots[1:] - inside
    largest = _largest_of_each(trajectory, begin, end)
    at = np.sort(np.concatenate([begin, end, time]))
    of = largest[np.clip(np.searchsorted(knots, at, side="right") - 1, 0, largest.size - 1)]
    share = np.divide(trajectory.acceleration(at), of, out=np.zeros(at.size), where=of > 0.0)
    firsts = np.minimum(np.searchsorted(at, time), at.size - 1)  # until the next reading
    high = maximum_filter1d(np.maximum.reduceat(share, firsts), 2 * width, mode="nearest")
    low = minimum_filter1d(np.minimum.reduceat(share, firsts), 2 * width, mode="nearest")
    near = high - low >= _SHARP
    jumps = np.abs(trajectory.velocity(begin[1:]) - trajectory.velocity(end[:-1]))
    sds = np.zeros(jumps.size)
    if trajectory.kinks.size:
        sds = _DOUBT * np.interp(knots[1:-1], trajectory.kinks, trajectory.kink_sd)
    for k in np.flatnonzero(jumps >= _MATERIAL * max(trajectory.top_speed, _TINY)):
        first, stop = np.searchsorted(time, [knots[k + 1] - sds[k], knots[k + 1] + sds[k]])
        near[max(first - width, 0) : stop + width] = True
    return near


def _largest_of_each(trajectory: Trajectory, begin: Array, end: Array) -> Array:
    """Return the largest acceleration (k,) of one sign that each piece belongs to.

    It is 0 where that changes the speed by little.
    """
    of = trajectory.acceleration
    size = np.max(np.abs([of(begin), of(0.5 * (begin + end)), of(end)]), axis=0)
    gained = trajectory.velocity(end) - trajectory.velocity(begin)
    parts = np.split(np.arange(gained.size), np.flatnonzero(np.diff(np.sign(gained))) + 1)
    largest = np.zeros(gained.size)
    for part in parts:
        if abs(np.sum(gained[part])) >= _MATERIAL * max(trajectory.top_speed, _TINY):
            largest[part] = np.max(size[part])
    return largest


def moving_mass(test: Test, trajectory: Trajectory, width: int) -> float:
    """Return the mass that the changes of force over ``width`` readings show; 0 if none.

    Changes of force are a mass times changes of acceleration, a stiffness times changes of
    displacement, and a drag times changes of speed (least squares).
    """
    if test.time.size < max(_FEWEST, 2 * width):
        return 0.0
    path = (trajectory.acceleration, trajectory.displacement, trajectory.velocity)
    columns = [_changes(of(test.time), width) for of in path]
    sizes = np.array([np.max(np.abs(one)) for one in columns])
    used = [k for k in range(3) if sizes[k] > 0.0]
    if 0 not in used:
        return 0.0
    scaled = np.stack([columns[k] / sizes[k] for k in used], axis=1)
    found = np.linalg.lstsq(scaled, _changes(test.force, width), rcond=1e-6)[0]
    return max(float(found[0]) / float(sizes[0]), 0.0)


def _changes(values: Array, width: int) -> Array:
    """Return the changes from the mean of some values to that of as many after them."""
    means = np.convolve(values, np.full(width, 1.0 / width), mode="valid")
    return means[width:] - means[:-width]
