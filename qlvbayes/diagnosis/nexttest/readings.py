"""What a further test of a pad would record: block means of its force, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from msgspec import structs
from scipy.linalg import solve_triangular

from qlvbayes.diagnosis.nexttest.design import Design, Rig
from qlvbayes.inference.errors.features import UNDECIDED, Locations
from qlvbayes.inference.errors.features import covariance as smooth_covariance
from qlvbayes.inference.errors.whitening import covariance as floor_covariance
from qlvbayes.io.arrays import Array
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.phases import KINDS, MOVING
from qlvbayes.motion.record import Blocks, Record, extended, held

BLOCKS = 128
"""Block means of a test."""
POINTS = 320
"""Points of a test's motion: two nodes for each mean, and up to 64 knots."""
_EARLY = 1e-4  # share of a dwell that its first block takes
_LONGER = 3.0  # largest ratio of a block to the one before; else the last takes nearly all
_MOVING = 1.0 / 3.0  # share of the blocks for all movements: their forces are simpler than dwells'


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
        scales, rig = experiment.scales, structs.replace(Rig.from_tests(experiment), **limits)
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
        grid = np.asarray(extended(grid, POINTS))
        columns = path.displacement(grid), path.velocity(grid), path.acceleration(grid)
        start, number = np.float64(self.clock + design.wait), np.float64(rig.done)
        motion = Motion(*map(held, (grid, *columns)), held(start), number=held(number))
        blocks = Blocks.of_means(np.zeros_like(count), count, middle - half, middle + half)
        full = jax.tree.map(lambda field: extended(field, BLOCKS), blocks)
        real = held(np.arange(BLOCKS) < begin.size)
        return Record(motion, extended(indices, BLOCKS), replace(full, real=real))

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
    move = max(int(_MOVING * BLOCKS) // moves, 1)
    rest = (BLOCKS - move * moves) // dwells
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
