"""The records of designs, and the errors of their readings against a model's force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from scipy.linalg import solve_triangular

from qlvbayes.diagnosis.nexttest.design import Design, Rig
from qlvbayes.inference.errors.features import UNDECIDED, Locations
from qlvbayes.inference.errors.features import covariance as smooth_covariance
from qlvbayes.inference.errors.whitening import covariance as floor_covariance
from qlvbayes.io.arrays import Array
from qlvbayes.laws.motion import Motion
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


def record_of(designs: Sequence[Design], rig: Rig, clock: float) -> Record:
    """Return the record of T tests, each of which begins when it has waited after ``clock`` (s)."""
    motions, nodes, blocks = zip(*(_one(design, rig) for design in designs), strict=True)
    time, displacement, velocity, acceleration = (
        jnp.asarray(np.stack(column)) for column in zip(*motions, strict=True)
    )
    start = jnp.asarray([clock + design.wait for design in designs])
    every = jax.tree.map(lambda *fields: jnp.asarray(np.stack(fields)), *blocks)
    number = jnp.full(start.shape, float(rig.done))
    motion = Motion(time, displacement, velocity, acceleration, start, number=number)
    return Record(motion, jnp.asarray(np.stack(nodes)), every)


def _one(design: Design, rig: Rig) -> tuple[tuple[Array, ...], JaxArray, Blocks]:
    """Return the columns of one design's motion, its nodes, and its blocks."""
    path = design.trajectory
    edges = _edges(design, rig.interval)
    begin, end = (np.concatenate(parts) for parts in zip(*edges, strict=True))
    width = end - begin
    count = _kept(np.maximum(np.round(width / rig.interval), 1.0), rig.rows)
    middle, half = 0.5 * (begin + end), 0.5 * width * (1.0 - 1.0 / count)
    # two nodes a block: the mean plus and minus one sd of evenly spaced readings
    spread = width * np.sqrt(np.maximum(1.0 - count**-2, 0.0) / 12.0)
    nodes = np.stack([middle - spread, middle + spread], axis=1)
    grid = np.unique(np.concatenate([path.knots, nodes.ravel()]))
    indices = np.searchsorted(grid, nodes)
    grid = np.asarray(extended(grid, POINTS))
    motion = (grid, path.displacement(grid), path.velocity(grid), path.acceleration(grid))
    blocks = Blocks.of_means(np.zeros_like(count), count, middle - half, middle + half)
    full = jax.tree.map(lambda field: extended(field, BLOCKS), blocks)
    real = held(np.arange(BLOCKS) < begin.size)
    return motion, extended(indices, BLOCKS), replace(full, real=real)


def _kept(count: Array, rows: int) -> Array:
    """Return the number of readings of each block where a logger keeps ``rows`` at most."""
    if count.sum() <= rows:
        return count
    ordered = np.sort(count)
    below = np.concatenate([[0.0], np.cumsum(ordered)[:-1]])
    most = (rows - below) / np.arange(count.size, 0, -1)
    first = int(np.argmax(most <= ordered))
    return np.asarray(np.maximum(np.floor(np.minimum(count, most[first])), 1.0))


def _edges(design: Design, interval: float) -> list[tuple[Array, Array]]:
    """Return begin and end (s) of the blocks of each movement and dwell."""
    stretches = design.stretches
    moves = sum(kind in MOVING for kind, *_ in stretches)
    dwells = max(len(stretches) - moves, 1)
    move = max(int(_MOVING * BLOCKS) // moves, 1)
    rest = (BLOCKS - move * moves) // dwells
    blocks = []
    for kind, start, stop in stretches:
        length = stop - start
        parts = int(np.clip(length / interval, 1, move if kind in MOVING else rest))
        if kind in MOVING or parts < 3:
            shares = np.linspace(0.0, 1.0, parts + 1)
        else:
            first = max(2.0 * interval / length, _EARLY, _LONGER ** (1.0 - parts))
            shares = np.concatenate([[0.0], np.geomspace(min(first, 0.5), 1.0, parts)])
        edges = start + length * shares
        blocks.append((edges[:-1], edges[1:]))
    return blocks


def locations_of(design: Design, rig: Rig, middle: Array, force: Array, peak: float) -> Locations:
    """Return the arguments of a discrepancy at the middles (n,) in s of the blocks of a design."""
    stretches = design.stretches
    starts = np.array([start for _, start, _ in stretches])
    which = np.searchsorted(starts[1:], middle, side="right")
    kinds = np.array([KINDS.index(kind) for kind, *_ in stretches])
    smooth = UNDECIDED.smooth(
        np.maximum(middle - starts[which], 0.0) + rig.interval,
        design.trajectory.displacement(middle) / rig.depth,
        np.full(middle.shape, design.speed),
    )
    size = UNDECIDED.size(force / peak)
    return Locations(smooth, size, kinds[which], np.zeros(middle.shape, np.intp))


@dataclass(frozen=True, eq=False)
class ReadingErrors:
    """The errors of readings in any test of a pad."""

    floor: NoiseFloor  # noise floor of the load cell
    peak: float  # largest force (N)
    # size (N) of the discrepancy that the diagnosis left in addition to the effects that it names;
    # 0 where it left none
    missed: float = 0.0

    @cached_property
    def expected(self) -> NoiseFloor:
        """The floor with all that the dwells leave open averaged over."""
        return self.floor.expected()

    def covariance(self, design: Design, rig: Rig, record: Record, force: Array) -> Array:
        """Return the covariance (n, n) of the block means of one design (N^2)."""
        real = np.asarray(record.blocks.real)
        own = jax.tree.map(lambda x: np.asarray(x)[real], record.blocks)
        own = replace(own, scale=self.floor.scale(force[real]))
        total = floor_covariance(self.expected, own, self.peak)
        if self.missed > 0.0:
            middle = 0.5 * (own.first + own.last)
            locations = locations_of(design, rig, middle, force[real], self.peak)
            smooth = smooth_covariance(locations, locations)
            total = total + self.missed**2 * (smooth + UNDECIDED.rough * np.eye(middle.size))
        return np.asarray(total)


def whitening(
    design: Design, index: int, record: Record, rig: Rig, errors: ReadingErrors, force: Array
) -> Callable[[Array], Array]:
    """Return the whitening of a design, which is the test ``index`` of a record.

    It takes block means (K, B) to independent values (K, n) of unit variance, without the padding.
    """
    own = jax.tree.map(lambda x: np.asarray(x)[index], record)
    real, root = own.blocks.real, np.linalg.cholesky(errors.covariance(design, rig, own, force))

    def white(vectors: Array) -> Array:
        return solve_triangular(root, vectors[:, real].T, lower=True, check_finite=False).T

    return white
