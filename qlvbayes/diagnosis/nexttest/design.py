"""Designs of tests within the limits of a rig, and where the platen has to be in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from msgspec import structs
from scipy.stats import qmc

from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import Part
from qlvbayes.io.units import UnitSystem, column_name
from qlvbayes.io.wording import plain
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.facts import Covered
from qlvbayes.motion.phases import Kind
from qlvbayes.motion.trajectory import Stroke, Trajectory, planned

DIMENSIONS = 8
"""Number of coordinates between 0 and 1 that determine a design."""
_LEAST_DEPTH = 0.2  # of the rig's depth: below, forces of soft pads drown in noise
_LEAST_HOLD = 100.0  # readings, by which a controller has settled
_GENTLEST = 0.1  # of the rig's acceleration
_FULL, _NONE = 0.4, 0.2  # shares of the draws that retract fully, and not at all
_CYCLES = (1, 1, 1, 2, 4, 7)  # equally likely; `records` could not hold the motion of more
_PATIENT = 0.25  # share of the draws that wait longer than recovery asks for
_LONGEST_WAIT = 10.0  # largest factor by which these wait longer
_HOME = 0.0  # mm: displacement at which a test begins, and to which it returns at its end


@dataclass(frozen=True)
class Design:
    """Design of one test: cycles of press, hold, retraction and rest, then the return to zero."""

    depth: float  # depth of the press (mm)
    # speed, acceleration: speed (mm/s) and acceleration (mm/s2) of every stroke
    speed: float
    acceleration: float
    # hold, rest: time (s) at depth, and after the retraction, in each cycle
    hold: float
    share: float = 0.0  # share of the depth by which the platen retracts
    rest: float = 0.0
    cycles: int = 1
    wait: float = 0.0  # time (s) before the test in which the pad recovers

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """The strokes without the way home."""
        press = (Stroke(self.depth, self.speed, self.hold),)
        if self.share <= 0.0:
            return press
        back = self.depth * (1.0 - self.share)
        return (*press, Stroke(back, self.speed, self.rest)) * self.cycles

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion, without the way home."""
        return planned(self.strokes, self.acceleration)

    @cached_property
    def whole(self) -> Trajectory:
        """The motion with the way home."""
        home = Stroke(_HOME, self.speed, 0.0)
        return planned((*self.strokes, home), self.acceleration)

    @property
    def stretches(self) -> list[tuple[Kind, float, float]]:
        """Kind, begin and end (s) of every movement and dwell, without the way home."""
        stretches: list[tuple[Kind, float, float]] = []
        position, time = _HOME, 0.0
        for stroke in self.strokes:
            way = abs(stroke.target - position)
            down = stroke.target > position
            if way > 0.0:
                top = min(stroke.speed, float(np.sqrt(self.acceleration * way)))
                until = time + way / top + top / self.acceleration
                stretches.append(("ramp" if down else "unload", time, until))
                time = until
            if stroke.hold > 0.0:
                stretches.append(("hold" if down else "recovery", time, time + stroke.hold))
                time += stroke.hold
            position = stroke.target
        return stretches

    @property
    def duration(self) -> float:
        """Duration of the test with the way home (s)."""
        return float(self.whole.knots[-1])

    @property
    def minutes(self) -> float:
        """Minutes of rig time: the wait before the test, and the test."""
        return (self.wait + self.duration) / 60.0

    def words(self, units: UnitSystem) -> str:
        """Return the test in words, as a part of a sentence."""
        speed, depth = f"{plain(self.speed)} {units.speed}", _length(self.depth, units)
        text = f"press to {depth} at {speed}, hold {plain(self.hold)} s"
        if self.share > 0.0:
            back = self.depth * (1.0 - self.share)
            way = "retract fully" if back <= 0.0 else f"retract to {_length(back, units)}"
            text += f", {way}, rest {plain(self.rest)} s"
        if self.share > 0.0 and self.cycles > 1:
            text += f"; {self.cycles} times"
        return f"{text}; after a pause of {plain(self.wait)} s" if self.wait > 0.0 else text


def _length(value: float, units: UnitSystem) -> str:
    return (
        f"strain {plain(value)}" if units.dimensionless else f"{plain(value)} {units.displacement}"
    )


def draw_designs(
    rig: Rig, recovery: RecoveryTime, longest: float, count: int, seed: int
) -> list[Design]:
    """Draw designs evenly over what the rig can do, by a scrambled Sobol sequence."""
    rows = qmc.Sobol(DIMENSIONS, seed=seed).random_base2(max(count - 1, 1).bit_length())[:count]
    designs = [_design(row, rig, recovery, longest) for row in rows]
    return [one for one in designs if one.wait + one.duration <= longest]


def _design(row: Array, rig: Rig, recovery: RecoveryTime, longest: float) -> Design:
    """Return the design that numbers (8,) between 0 and 1 determine."""
    depth, speed, acceleration, hold, share, rest, cycles, wait = row.tolist()
    least = _LEAST_HOLD * rig.interval
    count = _CYCLES[min(int(cycles * len(_CYCLES)), len(_CYCLES) - 1)]
    back = float(np.clip((share - _NONE) / (1.0 - _FULL - _NONE), 0.0, 1.0))
    count = count if back > 0.0 else 1
    design = Design(
        depth=rig.depth * (_LEAST_DEPTH + (1.0 - _LEAST_DEPTH) * np.sqrt(depth)),
        speed=_between(rig.slowest(longest), rig.speed, speed),
        acceleration=_between(_GENTLEST * rig.acceleration, rig.acceleration, acceleration),
        hold=max(_between(least, longest, hold) / count, least),
        share=back,
        rest=max(_between(least, longest, rest) / count, least) if back > 0.0 else 0.0,
        cycles=count,
    )
    patience = _LONGEST_WAIT ** (max(wait - (1.0 - _PATIENT), 0.0) / _PATIENT)
    return recovery.before(design, patience)


def _between(low: float, high: float, share: float) -> float:
    """Return the value at a share of the way from low to high in the logarithm."""
    # rounding must not go beyond the end
    return float(min(low * (high / low) ** share, high))


@dataclass(frozen=True, eq=False)
class RecoveryTime:
    r"""The time for which a pad must rest after a test until the force of it has died away."""

    # fractions c (L,) and rates v (L,) in 1/s of every explanation
    spectra: tuple[tuple[Array, Array], ...]

    def time(self, duration: float) -> float:
        """Return the rest (s) after a test of ``duration`` s until a share `FORGOTTEN` is left."""
        times = _RESTS
        left = np.zeros_like(times)
        for fractions, rates in self.spectra:
            excited = fractions * -np.expm1(-rates * duration)
            left = np.maximum(left, excited @ np.exp(-np.outer(rates, times)))
        enough = np.flatnonzero(left <= FORGOTTEN)
        return float(times[enough[0]]) if enough.size else float(times[-1])

    def before(self, design: Design, patience: float = 1.0) -> Design:
        """Return the design with the wait that it asks for after a test like itself."""
        wait = max(patience * self.time(design.duration), LEAST_WAIT)
        return replace(design, wait=wait)


FORGOTTEN = 0.01
"""Share of the force of a press that may be left when the next test begins."""
LEAST_WAIT = 30.0
"""Seconds between two tests of any pad, to save the file and start the rig again."""
_RESTS = np.geomspace(0.1, 3600.0, 300)  # s, rests that are tried


SET_POINTS = 1000.0
"""Set-points a second in the file for the rig, as the paper's controller takes them."""
_SLOWEST = 1e-5  # least share of the top speed: slower tests take too long


class Rig(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "interval": "interval_s", "done": "tests_before",
}):  # fmt: skip
    """The limits of a test on a rig, in the file's units."""

    # depth, speed, acceleration: greatest depth (mm), speed (mm/s) and acceleration (mm/s2)
    depth: float
    speed: float
    acceleration: float
    interval: float = 1.0 / SET_POINTS  # least time between two readings (s)
    # number of readings that are kept of a test; long dwells lose readings first
    rows: int = 10_000_000  # no logger keeps fewer
    done: int = 0  # number of tests that the pad has had

    @classmethod
    def from_tests(cls, experiment: Experiment) -> Rig:
        """Return the limits that the tests reached, and those of their logger."""
        scales = experiment.scales
        acceleration = scales.acceleration or scales.speed / (10.0 * scales.shortest)
        rows = max(trial.test.time.size for trial in experiment.trials)
        done = len(experiment.trials)
        return cls(scales.depth, scales.speed, acceleration, scales.shortest, rows, done)

    @classmethod
    def from_ranges(cls, covered: Covered) -> Rig:
        """Return the limits from the ranges that the tests cover."""
        return cls(covered.depth, covered.fastest, covered.fastest**2 / covered.depth)

    def limited(self, depth: float | None, speed: float | None, acceleration: float | None) -> Rig:
        """Return the rig with the limits that are given."""
        given = {"depth": depth, "speed": speed, "acceleration": acceleration}
        for name, value in given.items():
            if value is not None and not (value > 0.0 and math.isfinite(value)):
                raise InputError(f"--limits {name}={value:g}", remedy="give it above 0")
        return structs.replace(
            self,
            depth=depth or self.depth,
            speed=speed or self.speed,
            acceleration=acceleration or self.acceleration,
        )

    def slowest(self, longest: float) -> float:
        """Return the speed (mm/s) at which a ramp takes a quarter of the longest test (s)."""
        return min(max(_SLOWEST * self.speed, 4.0 * self.depth / longest), self.speed)


PAUSE = "pause"
"""Entry of the column ``test`` while the pad recovers."""
_DIGITS = 9  # more than any rig resolves
_ROUNDING = 1e-9  # of the depth


def names_of(count: int) -> list[str]:
    """Return the names of the tests of a series."""
    return [f"next-{k + 1}" for k in range(count)]


def set_points(designs: Sequence[Design]) -> tuple[Array, Array, list[str]]:
    """Return times (N,) in s, displacements (N,) in mm, and the name of the test of each."""
    times, displacements, tests = [], [], []
    begin = 0
    for k, (name, design) in enumerate(zip(names_of(len(designs)), designs, strict=True)):
        if k:
            pause = max(round(design.wait * SET_POINTS) - 1, 0)
            times.append(begin + 1 + np.arange(pause))
            displacements.append(np.zeros(pause))
            tests += [PAUSE] * pause
            begin += pause + 1
        count = int(np.ceil(design.duration * SET_POINTS)) + 1
        own = np.arange(count)
        times.append(begin + own)
        displacements.append(design.whole.displacement(own / SET_POINTS))
        tests += [name] * count
        begin += count - 1
    position = np.concatenate(displacements)
    position = np.where(np.abs(position) > _ROUNDING * position.max(), position, 0.0)
    return np.concatenate(times) / SET_POINTS, position, tests


def as_csv(designs: Sequence[Design], units: UnitSystem) -> str:
    """Return the text of the file, with the columns time_s, displacement and test."""
    time, position, tests = set_points(designs)
    name = column_name(units.displacement_name, "" if units.dimensionless else units.displacement)
    rows = [
        f"{t:.3f},{x:.{_DIGITS}g},{test}" for t, x, test in zip(time, position, tests, strict=True)
    ]
    return "\n".join([f"time_s,{name},test", *rows]) + "\n"
