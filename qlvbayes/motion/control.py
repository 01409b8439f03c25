r"""Find what was prescribed in each part of a test: the displacement, or the force.

A force that rests while the displacement goes on ever more slowly was prescribed: a specimen creeps
under a load, or recovers at no force. What is prescribed between such stretches is the quantity
that moves evenly, or rests, there.

Readings under a prescribed force are fitted as all others are, by the force of the measured
displacement. Readings F + e and :math:`\delta + d` of the true force and displacement leave

.. math:: r = (F + e) - F[\delta + d] \approx e - K d

whichever of the two was prescribed, K being the stiffness against a quick change. The noise is
measured on :math:`F - K \delta`, in which both errors show whatever the controller does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Control, Prescribed, Test
from qlvbayes.motion.falling import largest_stiffness
from qlvbayes.motion.phases import Phase, find_phases, phase_index
from qlvbayes.motion.sensor import sensor_noise
from qlvbayes.motion.trajectory import Trajectory

# They are no settings: what was prescribed is a fact of the record, and a column says it otherwise.
HELD = 0.05  # of the largest force, by which a held force may be read to either side of its level
_NOISY = 8.0  # sds of neighbouring readings, by which it may be too: slow errors are as large
_FEWEST = 20  # readings in a hold: fewer show no drift
_LONG = 0.05  # of a test's time: a force that is held for less was not prescribed
_LOADED = 0.2  # of the largest force, below which a specimen recovers, and its force hardly shows
_CREPT = 0.004  # of the largest displacement: less is what a held displacement drifts,
_SEEN = 3.0  # and so many resolutions of the displacement
_STEADY = 0.01  # of the largest force, above which a force scatters too much to be held
_SLOW_ERRORS = 4.0  # sds of neighbouring readings, above which too: it rises and relaxes at a turn
_PLAIN = 2.0  # times what the scatter of the force explains, above which a specimen creeps
_ENDS = 0.05  # of a hold's time at either end, where the movement next to it may reach in
_FADES = 1.05  # times as long as its second quarter the third takes; once at even speed
_CORNER = 6.0  # sds of a held force, beyond which two readings in a row are outside the hold,
_EXACT = 3e-4  # and so much of the largest force: in a smaller change rounding would decide
_EVENLY = 0.5  # of the other quantity's deviation from a straight line, below which one is even
_MIDDLE = (0.1, 0.9)  # of a movement, where it is compared with a straight line
_SHOWN = 6  # readings there, that show how even a movement is
_RESTS = 0.3  # of the time between two holds, or of a hold, for which one quantity rests there
_STOPS = 0.5  # of its way before, that it makes in the same time when it has stopped
_FEWEST_LEFT = 3  # readings in a phase that a change of control cuts


class LevelStretch(NamedTuple):
    """Readings from first to before stop, between which the force stays near a level."""

    first: int
    stop: int
    level: float
    held: bool


def controls_of(test: Test, trajectory: Trajectory) -> tuple[Prescribed, ...]:
    """Return what was prescribed in each stretch of a test, as declared, else as detected."""
    begin, end = map(float, trajectory.read_times(test.time)[[0, -1]])
    if test.changes:
        parts = [
            replace(part, start=max(part.start, begin), stop=min(part.stop, end))
            for part in test.changes
        ]
        return tuple(part for part in parts if part.start < part.stop)
    if test.control is not None:
        return (Prescribed(Control(test.control), begin, end),)
    holds, found = _creeping(test, trajectory), list[Prescribed]()
    bounds = [begin, *(time for hold in holds for time in hold), end]
    for k, (start, stop) in enumerate(pairwise(bounds)):
        if start >= stop:
            continue
        between = _between(test, trajectory, start, stop) if holds else Control.DISPLACEMENT
        control = Control.FORCE if k % 2 == 1 else between
        if found and found[-1].control == control:
            start = found.pop().start
        found.append(Prescribed(control, start, stop))
    return tuple(found)


def slack(test: Test) -> float:
    """Return how far from its level a held force may be read (N)."""
    noise = sensor_noise(test.time, test.force)
    return max(HELD * float(np.max(np.abs(test.force))), _NOISY * noise)


def stretches(test: Test) -> list[LevelStretch]:
    """Divide the record into stretches in which the force stays within its tolerance."""
    force, most, ends = test.force, 2.0 * slack(test), [0]
    low = high = float(force[0])
    for k, value in enumerate(force.tolist()):
        low, high = min(low, value), max(high, value)
        if high - low > most:
            ends.append(k)
            low = high = value
    parts = []
    for first, stop in pairwise([*ends, force.size]):
        time, some, held = test.time[first:stop], force[first:stop], False
        if some.size >= _FEWEST:
            centred = time - time.mean()
            drift = abs(float(centred @ some / (centred @ centred))) * float(np.ptp(time))
            held = drift < 0.5 * most
        parts.append(LevelStretch(first, stop, float(np.median(some)), held))
    return parts


def _creeping(test: Test, trajectory: Trajectory) -> list[tuple[float, float]]:
    """Return beginnings and ends (s) of the stretches of held force in which a specimen creeps."""
    holds: list[tuple[float, float]] = []
    if np.any(test.force) and np.any(test.displacement):
        for part in (part for part in stretches(test) if part.held):
            start, stop = _corners(test, part)
            apart = not holds or start > holds[-1][1]
            if apart and _creeps(test, trajectory, part.level, start, stop):
                holds.append((start, stop))
    return holds


def _creeps(test: Test, trajectory: Trajectory, level: float, first: float, last: float) -> bool:
    """Return whether the displacement goes on ever more slowly while the force is held (N)."""
    peak, depth = float(np.max(np.abs(test.force))), float(np.max(np.abs(test.displacement)))
    if last - first < _LONG * np.ptp(test.time) or abs(level) < _LOADED * peak:
        return False
    # a movement before or after may reach into it; what rests between them does not creep
    spare = _ENDS * (last - first)
    inside = (test.time >= first + spare) & (test.time <= last - spare)
    if np.count_nonzero(inside) < _FEWEST:
        return False
    time, displacement = test.time[inside], trajectory.displacement(test.time[inside])
    crept = float(displacement[-1] - displacement[0])
    scatter = float(np.std(test.force[inside]))
    if scatter > max(_STEADY * peak, _SLOW_ERRORS * sensor_noise(test.time, test.force)):
        return False
    rests = np.mean(trajectory.velocity(time) == 0.0) > _RESTS
    before, at, after = trajectory.displacement([first - spare, first, first + spare])
    if rests and not abs(after - at) < _STOPS * abs(at - before):  # as after a ramp that slows down
        return False
    explained = scatter * depth / peak
    least = max(_CREPT * depth, _SEEN * trajectory.resolution, _PLAIN * explained)
    if abs(crept) < least:
        return False
    share = np.maximum.accumulate((displacement - displacement[0]) / crept)
    quarters = np.interp([0.25, 0.5, 0.75], share, time)
    second, third = np.diff(quarters)
    return bool(third >= _FADES * second)


def _corners(test: Test, part: LevelStretch) -> tuple[float, float]:
    """Return when a held force begins and ends (s), to a reading."""
    first, stop, level, _ = part
    spare, middle = max(int(_ENDS * (stop - first)), 1), (first + stop) // 2
    sd = float(np.std(test.force[first + spare : stop - spare]))
    outside = np.abs(test.force - level) > max(_CORNER * sd, _EXACT * np.max(np.abs(test.force)))
    gone = outside[1:] & outside[:-1]
    before, after = np.flatnonzero(gone[: middle - 1]), np.flatnonzero(gone[middle:])
    begin = int(before[-1]) + 2 if before.size else 0
    end = middle + int(after[0]) - 1 if after.size else test.time.size - 1
    return float(test.time[begin]), float(test.time[max(end, begin)])


def _between(test: Test, trajectory: Trajectory, start: float, stop: float) -> Control:
    """Return which quantity rests or moves evenly between holds; the force where neither does."""
    inside = np.flatnonzero((test.time >= start) & (test.time <= stop))
    still = trajectory.velocity(test.time[inside]) == 0.0
    if inside.size and np.mean(still) > _RESTS:
        return Control.DISPLACEMENT
    low, high = (start + share * (stop - start) for share in _MIDDLE)
    inside = inside[(test.time[inside] >= low) & (test.time[inside] <= high)]
    if inside.size < _SHOWN:
        return Control.FORCE
    off = [_off_a_line(test.time[inside], x[inside]) for x in (test.displacement, test.force)]
    spread = [float(np.ptp(x[inside])) for x in (test.displacement, test.force)]
    bends = off[1] > _PLAIN * sensor_noise(test.time, test.force)
    displaced = bends and off[0] * spread[1] < _EVENLY * off[1] * spread[0]
    exact = inside.size >= _FEWEST and off[0] < trajectory.resolution  # no response is as straight
    return Control.DISPLACEMENT if displaced or exact else Control.FORCE


def _off_a_line(time: Array, values: Array) -> float:
    """Return the deviation (root mean square) of values (n,) from a straight line."""
    return float(np.std(values - np.polynomial.Polynomial.fit(time, values, 1)(time)))


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
        if share == 1.0 or (share > least and read >= _FEWEST_LEFT):
            pieces.append(replace(phase, start=start, stop=stop, control=part.control))
    if not pieces:
        longest = max(phases, key=lambda x: min(x.stop, part.stop) - max(x.start, part.start))
        pieces = [replace(longest, control=part.control)]
    bounds = pairwise([part.start, *(piece.start for piece in pieces[1:]), part.stop])
    return [
        replace(piece, start=start, stop=stop)
        for piece, (start, stop) in zip(pieces, bounds, strict=True)
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


def with_both_errors(tests: Sequence[Test], phases: Sequence[Sequence[Phase]]) -> list[Test]:
    """Return tests whose force has the errors of both readings, to measure noise: F - K delta."""
    every = [
        (test, phase_index(cut, test.time), [phase.control == Control.FORCE for phase in cut])
        for test, cut in zip(tests, phases, strict=True)
    ]
    secants = [_first_secant(test) for test, at, loaded in every if np.any(np.array(loaded)[at])]
    if not secants:
        return list(tests)
    stiffness, read = max(largest_stiffness(tests), *secants), []
    for test, which, loaded in every:
        force = test.force.copy()
        for k in np.intersect1d(which, np.flatnonzero(loaded)):
            way = test.displacement[which == k]
            force[which == k] -= stiffness * (way - way[-1])
        read.append(replace(test, force=force))
    return read


def _first_secant(test: Test) -> float:
    """Return force over displacement at the first reading near the largest force; 0 at no depth."""
    first = int(np.argmax(np.abs(test.force) >= (1.0 - HELD) * np.max(np.abs(test.force))))
    depth = abs(float(test.displacement[first]))
    return abs(float(test.force[first])) / depth if depth > 0.0 else 0.0
