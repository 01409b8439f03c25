r"""Load-controlled tests: the force is prescribed and the displacement responds.

They are fitted as all others are, by the force of the measured displacement. Where the true force
is F and the true displacement :math:`\delta`, readings F + e and :math:`\delta + d` leave

.. math:: r = (F + e) - F[\delta + d] \approx e - K d

whichever of the two was prescribed, K being the stiffness against a quick change. It is the
residual in displacement times that stiffness, and asks for no inverse. Both readings' errors are
in it, and a controller that follows the load cell moves errors of the one into the other: the
noise is measured on :math:`F - K \delta`, in which it shows whatever the controller does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.data import Control, Test
from qlvbayes.motion.phases import Phase, find_phases
from qlvbayes.motion.segments import sensor_noise
from qlvbayes.motion.stiffness import largest_stiffness
from qlvbayes.motion.trajectory import Trajectory

Array = NDArray[np.float64]

_HELD = 0.05  # of the largest force: so far to either side a held force may be read,
_NOISY = 8.0  # or so many sds of neighbouring readings, whose slow errors may be as large
_FEWEST = 20  # readings in a hold
_LONG = 0.2  # of a test, for which the force must be held to count as prescribed,
_LOADED = 0.2  # of the largest force, at which it must be held,
_CREPT = 0.03  # of the largest displacement, by which the specimen must creep meanwhile,
_PLAIN = 2.0  # times what the scatter of the force would explain,
_ENOUGH = 5000  # readings of a test that are looked at for that
_SLOWING = 0.35  # of the time, in which creep goes half its way; at even speed half of it
_ENDS = 0.05  # of the hold, at either end, that are not looked at for that


_BETWEEN = np.arange(1, 8) / 8.0  # of the time between two readings, where the motion is looked at
_SWING, _SWUNG = (
    1e-4,
    0.1,
)  # of the stroke, of the way between: how far a curve may lie outside both


@dataclass(frozen=True)
class _Stretch:
    """Readings from first to before stop, between which the force stays near a level."""

    first: int
    stop: int
    level: float
    held: bool


def control_of(test: Test) -> Control:
    """Return what was prescribed: as declared, else force if it is held while the pad creeps."""
    if test.control is not None:
        return test.control
    return "force" if _plainly_crept(test) else "displacement"


def crept_path(trajectory: Trajectory, test: Test) -> Trajectory:
    """Replace the motion by a straight line wherever it leaves the range of two readings.

    A curve through sparse readings of creep, faithful to each, may swing between them.
    """
    time = test.time
    ends = trajectory.displacement(time)
    inner = time[:-1, None] + np.diff(time)[:, None] * _BETWEEN
    low, high = np.minimum(ends[:-1], ends[1:]), np.maximum(ends[:-1], ends[1:])
    least = trajectory.resolution + _SWING * float(np.ptp(ends))
    spare = (least + _SWUNG * (high - low))[:, None]
    between = trajectory.displacement(inner)
    outside = (between < low[:, None] - spare) | (between > high[:, None] + spare)
    bad = np.asarray(np.any(outside, axis=1))
    if not bad.any():
        return trajectory
    knots = np.union1d(
        trajectory.knots, time[np.union1d(*(np.flatnonzero(bad) + k for k in (0, 1)))]
    )
    path, starts = trajectory.path, knots[:-1]
    order = path.c.shape[0] - 1
    rows = np.array([path.derivative(k)(starts) / factorial(k) for k in range(order + 1)])
    gap = np.clip(np.searchsorted(time, starts, side="right") - 1, 0, time.size - 2)
    line = bad[gap]
    slopes = np.diff(ends) / np.diff(time)
    rows[:, line] = 0.0
    rows[0, line] = (ends[gap] + slopes[gap] * (starts - time[gap]))[line]
    rows[1, line] = slopes[gap][line]
    return replace(
        trajectory,
        knots=knots,
        start_displacement=rows[0],
        start_velocity=rows[1],
        start_acceleration=2.0 * rows[2],
        higher=rows[3:] if order > 2 else None,
    )


def force_phases(test: Test) -> tuple[Phase, ...]:
    """Return the phases of a load-controlled test, which are those of its force."""
    knots, values = [float(test.time[0])], [float(test.force[0])]
    for part in _stretches(test):
        ends = test.time[[part.first, part.stop - 1]]
        corners = ends if part.held else [float(ends.mean())]
        if corners[0] <= knots[-1]:
            corners, values[-1] = corners[1:], part.level
        knots += list(corners)
        values += [part.level] * len(corners)
    if knots[-1] < test.time[-1]:
        knots, values = [*knots, float(test.time[-1])], [*values, values[-1]]
    slopes = np.diff(values) / np.diff(knots)
    path = Trajectory(
        np.array(knots), np.array(values[:-1]), slopes, np.zeros(slopes.size), 0.2 * _slack(test)
    )
    return find_phases(path)


def with_both_errors(tests: Sequence[Test], controls: Sequence[Control]) -> list[Test]:
    """Return tests whose force has the errors of both readings, to measure noise: F - K delta.

    K: the steepest slope of the pad's tests, or the secant as a weight is put on.
    """
    loaded = [test for test, control in zip(tests, controls, strict=True) if control == "force"]
    if not loaded:
        return list(tests)
    stiffness = max(largest_stiffness(tests), *(_first_secant(test) for test in loaded))
    return [
        replace(test, force=test.force - stiffness * (test.displacement - test.displacement[-1]))
        if control == "force"
        else test
        for test, control in zip(tests, controls, strict=True)
    ]


def _first_secant(test: Test) -> float:
    """Return force over displacement at the first reading near the largest force; 0 at no depth."""
    first = int(np.argmax(np.abs(test.force) >= (1.0 - _HELD) * np.max(np.abs(test.force))))
    depth = abs(float(test.displacement[first]))
    return abs(float(test.force[first])) / depth if depth > 0.0 else 0.0


def _stretches(test: Test) -> list[_Stretch]:
    """Divide the record into stretches in which the force stays within its tolerance.

    A ramp gives pieces that it crosses from one side to the other; a held force crosses none.
    """
    force, most = test.force, 2.0 * _slack(test)
    stretches, first = [], 0
    low = high = float(force[0])
    for k, value in enumerate(force.tolist()):
        low, high = min(low, value), max(high, value)
        if high - low > most:
            stretches.append(_stretch(test, first, k, most))
            first, low, high = k, value, value
    return [*stretches, _stretch(test, first, force.size, most)]


def _slack(test: Test) -> float:
    """Return how far from its level a held force may be read (N)."""
    return max(
        _HELD * float(np.max(np.abs(test.force))), _NOISY * sensor_noise(test.time, test.force)
    )


def _stretch(test: Test, first: int, stop: int, most: float) -> _Stretch:
    time, force = test.time[first:stop], test.force[first:stop]
    held = False
    if force.size >= _FEWEST:
        centred = time - time.mean()
        drift = abs(float(centred @ force / (centred @ centred))) * float(np.ptp(time))
        held = drift < 0.5 * most
    return _Stretch(first, stop, float(np.median(force)), held)


def _plainly_crept(test: Test) -> bool:
    """Return whether the force is held for long while the displacement creeps, slowing down."""
    peak, depth = np.max(np.abs(test.force)), float(np.max(np.abs(test.displacement)))
    if peak == 0.0 or depth == 0.0:
        return False
    every = slice(None, None, max(test.time.size // _ENOUGH, 1))
    test = replace(
        test, time=test.time[every], displacement=test.displacement[every], force=test.force[every]
    )
    for part in _stretches(test):
        first, last = test.time[[part.first, part.stop - 1]]
        long = last - first >= _LONG * np.ptp(test.time) and abs(part.level) >= _LOADED * peak
        if not (part.held and long):
            continue
        # a movement before or after may reach into it; what rests between them does not creep
        spare = _ENDS * (last - first)
        inside = (test.time >= first + spare) & (test.time <= last - spare)
        time, displacement = test.time[inside], test.displacement[inside]
        crept = float(displacement[-1] - displacement[0])
        explained = float(np.std(test.force[inside])) * depth / float(peak)
        if abs(crept) < max(_CREPT * depth, _PLAIN * explained):
            continue
        half = float(
            np.interp(0.5, np.maximum.accumulate((displacement - displacement[0]) / crept), time)
        )
        if half - time[0] <= _SLOWING * np.ptp(time):
            return True
    return False
