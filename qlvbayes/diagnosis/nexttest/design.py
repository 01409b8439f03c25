"""Designs of tests within the limits of a rig, and what it would read in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from msgspec import structs
from scipy.linalg import solve_triangular
from scipy.stats import qmc

from qlvbayes.inference.errors.features import UNDECIDED, Locations
from qlvbayes.inference.errors.features import covariance as smooth_covariance
from qlvbayes.inference.errors.whitening import covariance as floor_covariance
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import Part
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.phases import KINDS, MOVING, Kind
from qlvbayes.motion.record import Blocks, Record, extended, held
from qlvbayes.motion.trajectory import Stroke, Trajectory, planned

_SLOWEST = 1e-5  # least share of the top speed: slower tests take too long
_LEAST_DEPTH = 0.2  # of the rig's depth: below, forces of soft pads drown in noise
_LEAST_HOLD = 100.0  # readings, by which a controller has settled
_LEAST_BACK = 0.02  # share of the depth, below which a retraction is none
_GENTLEST = 0.1  # of the rig's acceleration
_FULL, _NONE = 0.4, 0.2  # shares of the draws that retract fully, and not at all
_CYCLES = (1, 1, 1, 2, 4, 7)  # equally likely; `records` could not hold the motion of more
LEAST_WAIT = 30.0
"""Seconds between two tests of any pad, to save the file and start the rig again."""
_PATIENT = 0.25  # share of the draws that wait longer than recovery asks for
_LONGEST_WAIT = 10.0  # largest factor by which these wait longer
_SAME_UNIT = 0.01  # of the tests' depth: a limit below it is one in another unit
_BLOCKS = 128  # means of a test
_POINTS = 320  # of a test's motion: two nodes for each mean, and up to 64 knots
_EARLY = 1e-4  # share of a dwell that its first block takes
_LONGER = 3.0  # largest ratio of a block to the one before; else the last takes nearly all
_MOVING = 1.0 / 3.0  # share of the blocks for all movements: their forces are simpler than dwells'


class Rig(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "interval": "interval_s", "done": "tests_before",
}):  # fmt: skip
    """The limits of a test on a rig, in the file's units."""

    # depth, speed, acceleration: greatest depth (mm), speed (mm/s) and acceleration (mm/s2)
    depth: float
    speed: float
    acceleration: float
    interval: float = 1e-3  # least time between two readings (s)
    # number of readings that are kept of a test; long dwells lose readings first
    rows: int = 10_000_000  # no logger keeps fewer
    done: int = 0  # number of tests that the pad has had


class Design(Part, frozen=True, rename={
    "depth": "depth_mm", "speed": "speed_mm_s", "acceleration": "acceleration_mm_s2",
    "hold": "hold_s", "share": "retraction_share", "rest": "rest_s", "wait": "pause_s",
}):  # fmt: skip
    """Design of one test: cycles of press, hold, retraction and rest, then the return to zero."""

    # depth, speed, acceleration: depth (mm), speed (mm/s) and acceleration (mm/s2) of every press
    depth: float
    speed: float
    acceleration: float
    # hold, share, rest, cycles: times (s) at depth and after the retraction, share of the depth by
    # which the platen retracts, and number of cycles
    hold: float
    share: float = 0.0
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

    @property
    def trajectory(self) -> Trajectory:
        """The motion with the way home."""
        return planned((*self.strokes, Stroke(0.0, self.speed, 0.0)), self.acceleration)

    @property
    def stretches(self) -> list[tuple[Kind, float, float]]:
        """Kind, begin and end (s) of every movement and dwell, without the way home."""
        stretches: list[tuple[Kind, float, float]] = []
        place, begin = 0.0, 0.0
        for k, stroke in enumerate(self.strokes):
            end = float(planned(self.strokes[: k + 1], self.acceleration).knots[-1])
            down, dwell = stroke.target > place, end - stroke.hold
            stretches.append(("ramp" if down else "unload", begin, dwell))
            stretches.append(("hold" if down else "recovery", dwell, end))
            place, begin = stroke.target, end
        return stretches

    @property
    def seconds(self) -> float:
        """Duration of the test with the way home (s)."""
        return float(self.trajectory.knots[-1])

    def in_words(self, units: UnitSystem) -> str:
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
    rig: Rig, recovery: Callable[[float], float], longest: float, count: int, seed: int
) -> list[Design]:
    """Draw designs evenly over what the rig can do, by a scrambled Sobol sequence.

    recovery: duration of a test (s) to the rest after it; longest: a test with the rest before (s).
    """
    rows = qmc.Sobol(8, seed=seed).random_base2(max(count - 1, 1).bit_length())[:count]
    designs = [_design(row, rig, recovery, longest) for row in rows]
    return [one for one in designs if one.wait + one.seconds <= longest]


def _design(row: Array, rig: Rig, recovery: Callable[[float], float], longest: float) -> Design:
    """Return the design that numbers (8,) between 0 and 1 determine."""
    depth, speed, acceleration, hold, share, rest, cycles, wait = row.tolist()
    least = _LEAST_HOLD * rig.interval
    slowest = max(_SLOWEST * rig.speed, 4.0 * rig.depth / longest)  # a quarter of the longest test
    back = float(np.clip((share - _NONE) / (1.0 - _FULL - _NONE), 0.0, 1.0))
    back = back if back > _LEAST_BACK else 0.0
    count = _CYCLES[min(int(cycles * len(_CYCLES)), len(_CYCLES) - 1)] if back > 0.0 else 1
    depth = rig.depth * (_LEAST_DEPTH + (1.0 - _LEAST_DEPTH) * float(np.sqrt(depth)))
    acceleration = _between(_GENTLEST * rig.acceleration, rig.acceleration, acceleration)
    speed = _between(min(slowest, rig.speed), rig.speed, speed)
    design = Design(
        depth=depth,
        speed=min(speed, float(np.sqrt(acceleration * depth))),  # a press does not reach more
        acceleration=acceleration,
        hold=max(_between(least, longest, hold) / count, least),
        share=back,
        rest=max(_between(least, longest, rest) / count, least) if back > 0.0 else 0.0,
        cycles=count,
    )
    patience = _LONGEST_WAIT ** (max(wait - (1.0 - _PATIENT), 0.0) / _PATIENT)
    return structs.replace(design, wait=max(patience * recovery(design.seconds), LEAST_WAIT))


def _between(low: float, high: float, share: float) -> float:
    """Return the value at a share of the way from low to high in the logarithm."""
    # rounding must not go beyond the end
    return float(min(low * (high / low) ** share, high))


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of any further test of a pad: the limits of its rig, and their errors."""

    rig: Rig
    floor: NoiseFloor  # noise floor of the load cell
    peak: float  # largest force of the tests so far (N)
    # size (N) of the discrepancy that is left in addition to the effects that are named
    missed: float = 0.0
    clock: float = 0.0  # time on the pad's clock after these tests (s)

    @classmethod
    def after(cls, experiment: Experiment, missed: float, **limits: float) -> Readings:
        """Return those after some tests, within their limits where no others are given."""
        scales, trials = experiment.scales, experiment.trials
        acceleration = scales.acceleration or scales.speed / (10.0 * scales.shortest)
        rows = max(trial.test.time.size for trial in trials)
        known = scales.depth, scales.speed, acceleration, scales.shortest, rows, len(trials)
        rig = structs.replace(Rig(*known), **limits)
        if rig.depth < _SAME_UNIT * scales.depth:
            unit, deepest = experiment.units.displacement, plain(scales.depth)
            what = f"a depth of at most {rig.depth:g} {unit}, where the tests had {deepest} {unit}"
            raise InputError(what, remedy="give the limits in the units of the file")
        return cls(rig, experiment.floor, scales.force, missed, scales.clock)

    def record(self, designs: Sequence[Design]) -> Record:
        """Return the record of T tests, each of which begins when it has waited."""
        records = [self._record(design) for design in designs]
        record: Record = jax.tree.map(lambda *leaves: np.stack(leaves), *records)
        return record

    def _record(self, design: Design) -> Record:
        path, rig = design.trajectory, self.rig
        begin, end = _edges(design, rig.interval)
        width = end - begin
        # a logger that keeps few readings has them evenly over the blocks
        count = np.round(np.minimum(width / rig.interval, max(rig.rows / width.size, 1.0)))
        count = np.maximum(count, 1.0)
        middle, half = 0.5 * (begin + end), 0.5 * width * (1.0 - 1.0 / count)
        # two nodes a block: the mean plus and minus one sd of evenly spaced readings
        spread = width * np.sqrt(np.maximum(1.0 - count**-2, 0.0) / 12.0)
        nodes = np.stack([middle - spread, middle + spread], axis=1)
        grid = np.unique(np.concatenate([path.knots, nodes.ravel()]))
        indices = np.searchsorted(grid, nodes)
        grid = np.asarray(extended(grid, _POINTS))
        x, v, a = path.displacement(grid), path.velocity(grid), path.acceleration(grid)
        start, number = held(self.clock + design.wait), held(float(rig.done))
        motion = Motion(held(grid), held(x), held(v), held(a), start, number=number)
        blocks = Blocks.of_means(np.zeros_like(count), count, middle - half, middle + half)
        full = jax.tree.map(lambda field: extended(field, _BLOCKS), blocks)
        real = held(np.arange(_BLOCKS) < begin.size)
        return Record(motion, extended(indices, _BLOCKS), replace(full, real=real))

    @cached_property
    def _expected(self) -> NoiseFloor:
        """The floor with all that the dwells leave open averaged over."""
        return self.floor.expected()

    def whitened(self, design: Design, blocks: Blocks, force: Array, vectors: Array) -> Array:
        """Return block means (K, B) of a design as independent values (K, n) of unit variance.

        force (B,): that of the likeliest explanation, with which the noise may grow.
        """
        real = np.asarray(blocks.real)
        own: Blocks = jax.tree.map(lambda x: np.asarray(x)[real], blocks)
        own = replace(own, scale=held(self.floor.scale(force[real])))
        covariance = floor_covariance(self._expected, own, self.peak)
        if self.missed > 0.0:
            middle = 0.5 * (np.asarray(own.first) + np.asarray(own.last))
            locations = self._locations(design, middle, force[real])
            smooth = smooth_covariance(locations, locations)
            covariance += self.missed**2 * (smooth + UNDECIDED.rough * np.eye(middle.size))
        root = np.linalg.cholesky(covariance)
        return solve_triangular(root, vectors[:, real].T, lower=True, check_finite=False).T

    def _locations(self, design: Design, middle: Array, force: Array) -> Locations:
        """Return the arguments of a discrepancy at the middles (n,) in s of a design's blocks."""
        kinds, starts, _ = zip(*design.stretches, strict=True)
        begun = np.array(starts)
        which = np.searchsorted(begun[1:], middle, side="right")
        smooth = UNDECIDED.smooth(
            np.maximum(middle - begun[which], 0.0) + self.rig.interval,
            design.trajectory.displacement(middle) / self.rig.depth,
            np.full(middle.shape, design.speed),
        )
        phase = np.array([KINDS.index(kind) for kind in kinds])[which]
        size = UNDECIDED.size(force / self.peak)
        return Locations(smooth, size, phase, np.zeros(middle.shape, np.intp))


def _edges(design: Design, interval: float) -> tuple[Array, Array]:
    """Return begin and end (s) of the blocks of all movements and dwells."""
    stretches = design.stretches
    moves = sum(kind in MOVING for kind, *_ in stretches)
    dwells = max(len(stretches) - moves, 1)
    move = max(int(_MOVING * _BLOCKS) // moves, 1)
    rest = (_BLOCKS - move * moves) // dwells
    begin, end = [], []
    for kind, start, stop in stretches:
        length = stop - start
        parts = int(np.clip(length / interval, 1, move if kind in MOVING else rest))
        if kind in MOVING or parts < 3:
            shares = np.linspace(0.0, 1.0, parts + 1)
        else:
            first = max(2.0 * interval / length, _EARLY, _LONGER ** (1.0 - parts))
            shares = np.concatenate([[0.0], np.geomspace(min(first, 0.5), 1.0, parts)])
        begin.append(start + length * shares[:-1])
        end.append(start + length * shares[1:])
    return np.concatenate(begin), np.concatenate(end)
