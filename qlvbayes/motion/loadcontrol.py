r"""Load control, in a test or in a part of it: the force is prescribed, the displacement responds.

Such readings are fitted as all others are, by the force of the measured displacement. Readings F +
e and :math:`\delta + d` of the true force and displacement leave

.. math:: r = (F + e) - F[\delta + d] \approx e - K d

whichever of the two was prescribed, K being the stiffness against a quick change. The noise is
measured on :math:`F - K \delta`, in which both errors show whatever the controller does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import factorial

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Control, Prescribed, Test
from qlvbayes.motion.control import HELD, slack, stretches
from qlvbayes.motion.phases import Phase, find_phases, phase_index
from qlvbayes.motion.stiffness import largest_stiffness
from qlvbayes.motion.trajectory import Trajectory

_FEWEST = 3  # readings in a phase that a change of control cuts
_ON_A_CURVE = 10  # readings of a ramp that show how the slope grows
_POINTS = 200  # of that ramp, at which its force is computed
_BETWEEN = np.arange(1, 8) / 8.0  # of the time between two readings, where the motion is looked at
_SWING = 1e-4  # of the stroke, by which a curve may lie outside the readings to either side,
_SWUNG = 0.1  # and of the way between the two: more is no creep


def crept_path(trajectory: Trajectory, test: Test, phases: Sequence[Phase]) -> Trajectory:
    """Replace the motion of creep by a straight line where it leaves the range of two readings."""
    time = test.time
    loaded = loaded_readings(time[:-1], phases)
    if not loaded.any():
        return trajectory
    ends = trajectory.displacement(time)
    inner = time[:-1, None] + np.diff(time)[:, None] * _BETWEEN
    low, high = np.minimum(ends[:-1], ends[1:]), np.maximum(ends[:-1], ends[1:])
    least = trajectory.resolution + _SWING * float(np.ptp(ends))
    spare = (least + _SWUNG * (high - low))[:, None]
    between = trajectory.displacement(inner)
    outside = (between < low[:, None] - spare) | (between > high[:, None] + spare)
    bad = np.any(outside, axis=1) & loaded
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


def phases_of(
    test: Test, trajectory: Trajectory, controls: Sequence[Prescribed]
) -> tuple[Phase, ...]:
    """Return the phases of a test's displacement, or of its force where that is prescribed."""
    phases: list[Phase] = []
    of: dict[Control, tuple[Phase, ...]] = {}
    for part in controls:
        if part.control not in of:
            loaded = part.control == Control.FORCE
            read = trajectory.read_times(test.time)
            of[part.control] = force_phases(test, read) if loaded else find_phases(trajectory)
        phases += _within(of[part.control], part, test.time)
    return tuple(phases)


def _within(phases: Sequence[Phase], part: Prescribed, time: Array) -> list[Phase]:
    """Return the phases within a stretch of time, which they fill."""
    pieces: list[Phase] = []
    for phase in phases:
        start, stop = max(phase.start, part.start), min(phase.stop, part.stop)
        share = (stop - start) / (phase.stop - phase.start)
        least = 0.5 if part.control == Control.FORCE else 0.0
        read = np.count_nonzero((time >= start) & (time <= stop))
        if share == 1.0 or (share > least and read >= _FEWEST):
            pieces.append(replace(phase, start=start, stop=stop, control=part.control))
    if not pieces:
        longest = max(phases, key=lambda x: min(x.stop, part.stop) - max(x.start, part.start))
        pieces = [replace(longest, control=part.control)]
    starts = [part.start, *(piece.start for piece in pieces[1:])]
    stops = [*starts[1:], part.stop]
    return [
        replace(piece, start=start, stop=stop)
        for piece, start, stop in zip(pieces, starts, stops, strict=True)
    ]


def force_phases(test: Test, read: Array) -> tuple[Phase, ...]:
    """Return the phases of a test's force; read (n,): times of all readings of displacement (s)."""
    knots, values = [float(read[0])], [float(test.force[0])]
    for part in stretches(test):
        ends = test.time[[part.first, part.stop - 1]]
        corners = ends if part.held else [float(ends.mean())]
        if corners[0] <= knots[-1]:
            corners, values[-1] = corners[1:], part.level
        knots += list(corners)
        values += [part.level] * len(corners)
    if knots[-1] < read[-1]:
        knots, values = [*knots, float(read[-1])], [*values, values[-1]]
    slopes = np.diff(values) / np.diff(knots)
    path = Trajectory(
        np.array(knots), np.array(values[:-1]), slopes, np.zeros(slopes.size), 0.2 * slack(test)
    )
    return find_phases(path)


def loaded_readings(time: Array, phases: Sequence[Phase]) -> NDArray[np.bool_]:
    """Return which times (n,) lie in phases of prescribed force."""
    loaded = np.array([phase.control == Control.FORCE for phase in phases])
    return np.asarray(loaded[phase_index(phases, time)])


def with_both_errors(tests: Sequence[Test], phases: Sequence[Sequence[Phase]]) -> list[Test]:
    """Return tests whose force has the errors of both readings, to measure noise: F - K delta."""
    loaded = [loaded_readings(test.time, cut) for test, cut in zip(tests, phases, strict=True)]
    secants = [_first_secant(test) for test, some in zip(tests, loaded, strict=True) if some.any()]
    if not secants:
        return list(tests)
    stiffness = max(largest_stiffness(tests), *secants)
    curve = _elastic_curve(tests, phases)
    read = []
    for test, cut, some in zip(tests, phases, loaded, strict=True):
        force, which = test.force.copy(), phase_index(cut, test.time)
        quick = stiffness * curve(test.displacement)
        for k in np.unique(which[some]):
            inside = which == k
            force[inside] -= quick[inside] - quick[inside][-1]
        read.append(replace(test, force=force))
    return read


def _elastic_curve(
    tests: Sequence[Test], phases: Sequence[Sequence[Phase]]
) -> Callable[[Array], Array]:
    """Return the deepest ramp's force as a function of displacement, its last slope being one."""
    ramps = []
    for test, cut in zip(tests, phases, strict=True):
        which = phase_index(cut, test.time)
        for k in (k for k, phase in enumerate(cut) if phase.kind == "ramp"):
            displacement, force = test.displacement[which == k], test.force[which == k]
            if displacement.size >= _ON_A_CURVE and np.ptp(displacement) > 0.0:
                ramps.append((float(np.max(np.abs(displacement))), displacement, force))
    if not ramps:
        return np.asarray
    _, displacement, force = max(ramps, key=lambda ramp: ramp[0])
    cubic = np.polynomial.Polynomial.fit(displacement, force, 3)
    points = np.linspace(displacement.min(), displacement.max(), _POINTS)
    values = np.maximum.accumulate(cubic(points))
    end = int(np.argmax(np.abs(points)))
    slope = float(cubic.deriv()(points[end]))
    if not slope > 0.0:
        return np.asarray

    def curve(x: Array) -> Array:
        beyond = x - np.clip(x, points[0], points[-1])
        return np.asarray(
            np.interp(x, points, values) / slope + np.where(beyond * points[end] > 0.0, beyond, 0.0)
        )

    return curve


def _first_secant(test: Test) -> float:
    """Return force over displacement at the first reading near the largest force; 0 at no depth."""
    first = int(np.argmax(np.abs(test.force) >= (1.0 - HELD) * np.max(np.abs(test.force))))
    depth = abs(float(test.displacement[first]))
    return abs(float(test.force[first])) / depth if depth > 0.0 else 0.0
