"""Reduction of dense records to block averages: short blocks in ramps, growing ones in holds.

No sample is thrown away: each belongs to one block, whose mean enters the likelihood with the
noise of that mean. Within a block the model is averaged with two nodes at the mean time plus and
minus one sd of the sample times, exact for a force that is cubic in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np

from qlvbayes.io.data import Test
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.grid import grid_times, path_at
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.past import EarlierMotion
from qlvbayes.motion.patherrors import path_errors
from qlvbayes.motion.phases import MOVING, Phase, find_phases
from qlvbayes.motion.record import Blocks, RateErrors, Record, held, padded_size
from qlvbayes.motion.timing import off_kinks, timing_sd
from qlvbayes.motion.trajectory import Trajectory

GROWTH = 0.2  # a block's width over the time since its phase began
MOVING_BLOCKS = 20  # at least so many in a ramp or unloading,
RESTING_BLOCKS = 8  # and in a hold
_MOST_KINKS = 40
_MARGIN = 1.2  # sampling intervals either side of a kink that are left out,
_SPARED = 0.03  # if they are at most this share of the phases around it
_EVEN = 1.5  # a gap this much longer than the one next to it ends a block
_SURE = 3.0  # sds of the displacement over which a slope is known


@dataclass(frozen=True)
class Fineness:
    """Fineness with which a record is to be reduced, given its noise."""

    floor: NoiseFloor  # noise and its growth with the force
    # the pad's largest (N/mm), by which an error of the motion becomes one of the force
    stiffness: float
    # how far the grid's straight lines may be from the motion (mm), where less than the default
    chord: float


def block_edges(phases: Sequence[Phase], kinks: np.ndarray, shortest: float) -> np.ndarray:
    """Return the times at which blocks begin and end; no block crosses a phase's end or a kink."""
    edges = [np.array([phases[0].start])]
    for phase in phases:
        parts = MOVING_BLOCKS if phase.kind in MOVING else RESTING_BLOCKS
        edges.append(_phase_edges(phase, parts, shortest))
    if kinks.size <= _MOST_KINKS:
        edges.append(kinks)
    return np.unique(np.concatenate(edges))


def _phase_edges(phase: Phase, parts: int, shortest: float) -> np.ndarray:
    """Return edges whose spacing grows with the time since the phase began."""
    length = phase.stop - phase.start
    longest = length / parts
    edges, elapsed = [], 0.0
    while elapsed < length:
        elapsed += min(max(GROWTH * elapsed, shortest), max(longest, shortest))
        edges.append(elapsed)
    edges[-1] = length
    return phase.start + np.array(edges)


def _beginnings(time: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the first sample of each block: at an edge, and after a gap in even spacing.

    The noise of a block's mean is that of evenly spaced samples; a burst between sparse samples,
    as loggers leave, is a block of its own.
    """
    owner = np.searchsorted(edges, time, side="right")
    gap = np.diff(time)
    before, after = np.append(gap[:1], gap[:-1]), np.append(gap[1:], gap[-1:])
    uneven = gap > _EVEN * np.minimum(before, after)
    first = np.concatenate([[True], (np.diff(owner) > 0) | uneven])
    return np.flatnonzero(first)


def clear_of_kinks(time: np.ndarray, trajectory: Trajectory, phases: Sequence[Phase]) -> np.ndarray:
    """Return False (n,) for samples so near a kink that their side of it is unknown."""
    clear = np.ones(time.size, dtype=bool)
    for low, high in _doubtful(time, trajectory, phases):
        clear &= (time < low) | (time > high)
    return clear


def _doubtful(
    time: np.ndarray, trajectory: Trajectory, phases: Sequence[Phase]
) -> list[tuple[float, float]]:
    """Return the stretches around kinks whose times the samples do not determine.

    A sample either side, and the time in which the change of speed makes an encoder step. Only
    densely sampled records can spare them. The samples are those of the displacement.
    """
    time = trajectory.read_times(time)
    kinks, jumps = trajectory.kinks, trajectory.speed_jumps
    if kinks.size > _MOST_KINKS:
        return []
    if trajectory.start_velocity[0] or trajectory.start_acceleration[0]:  # moves from the start
        kinks = np.concatenate([trajectory.knots[:1], kinks])
        jumps = np.concatenate([np.abs(trajectory.start_velocity[:1]), jumps])
    lengths = np.array([phase.stop - phase.start for phase in phases])
    ends = np.array([phase.stop for phase in phases])
    stretches = []
    for kink, jump in zip(kinks, jumps, strict=True):
        index = min(int(np.searchsorted(ends, kink)), lengths.size - 1)
        around = lengths[max(index - 1, 0) : index + 2].min()
        at = int(np.clip(np.searchsorted(time, kink), 1, time.size - 1))
        reach = _MARGIN * float(time[at] - time[at - 1])
        if reach > _SPARED * around:
            continue
        if jump > 0.0:
            reach += min(trajectory.resolution / jump, _SPARED * around)
        stretches.append((kink - reach, kink + reach))
    return stretches


def reduce_test(
    test: Test,
    trajectory: Trajectory,
    phases: Sequence[Phase],
    *,
    sd_scale: float = 1.0,
    start: float = 0.0,
    number: int = 0,
    blocks: bool = True,
    past: EarlierMotion | None = None,
    fineness: Fineness | None = None,
    whole: Test | None = None,
    approached: bool = True,
    errors: bool = False,
) -> Record:
    """Return the record of one test: block means, their nodes, and the motion on a grid of times.

    sd_scale: what measured sds are divided by; start: the pad's clock at time 0 (s); number: how
    many tests the pad has had before; blocks: False keeps every sample by itself; past: what the
    test remembers of earlier ones; fineness: None where force and noise are not known yet; whole:
    the test of which these are some samples only; approached: whether a record that begins on the
    move came from zero by an approach before it; errors: whether to include those of the motion's
    velocity and acceleration.
    """
    whole = whole or test
    begin = np.arange(test.time.size)
    kept = np.ones(begin.size, dtype=bool)
    if blocks:
        shortest = 2.0 * float(np.median(np.diff(test.time)[:200]))
        doubtful = _doubtful(test.time, trajectory, phases)
        edges = block_edges(phases, trajectory.kinks, shortest)
        edges = np.unique(np.concatenate([edges, *map(np.array, doubtful)]))
        begin = _beginnings(test.time, edges)
        kept = clear_of_kinks(test.time, trajectory, phases)[begin]
    averaged = jax.tree.map(lambda x: held(np.asarray(x)[kept]), _average(test, begin, sd_scale))
    centre, half = (x[kept] for x in _nodes(test.time, begin))
    half = off_kinks(centre, half, whole.time, trajectory)
    nodes = np.stack([centre - half, centre + half])
    if fineness is not None:
        averaged = _with_errors(averaged, trajectory, centre, fineness)
        rows, white = np.searchsorted(whole.time, test.time), fineness.floor.white
        timing = timing_sd(whole.time, whole.force, begin, trajectory, white, rows)[kept]
        averaged = replace(averaged, timing=held(timing))
    chord = np.inf if fineness is None else fineness.chord
    begun = approached and (past is None or not past.stays)
    first = float(trajectory.read_times(whole.time)[0])
    grid, curved = _grid(trajectory, np.unique(nodes), first, chord, begun)
    motion = _motion(trajectory, grid, first, curved)
    motion = replace(motion, start=held(np.float64(start)), number=held(np.float64(number)))
    indices = np.searchsorted(grid, nodes).T
    wrong = _rate_errors(whole, trajectory, grid) if errors else None
    if past is not None:
        motion, indices = _remembering(motion, past), indices + past.time.size
        before = ((0, 0), (past.time.size, 0))
        wrong = jax.tree.map(lambda rows: held(np.pad(rows, before)), wrong)
    return Record(motion, held(indices), averaged, wrong)


def _rate_errors(test: Test, trajectory: Trajectory, grid: np.ndarray) -> RateErrors:
    """Return the errors of velocity and acceleration on the grid, by the displacement's readings.

    Not all of the test's are: the displacement may be read more seldom than the force.
    """
    read = np.isin(test.time, trajectory.read_times(test.time))
    found = path_errors(test.time[read], test.displacement[read], trajectory, grid)
    return RateErrors(held(found.velocity), held(found.acceleration))


def planned_record(
    trajectory: Trajectory, time: np.ndarray, *, start: float, blocks: bool = True
) -> Record:
    """Return the record of a test that is not done yet, with zero force; see ``reduce_test``."""
    test = Test("", "", time, trajectory.displacement(time), np.zeros_like(time))
    return reduce_test(test, trajectory, find_phases(trajectory), start=start, blocks=blocks)


def _grid(
    trajectory: Trajectory, nodes: np.ndarray, first: float, chord: float, begun: bool
) -> tuple[np.ndarray, bool]:
    """Return the grid of times, and whether curvature is stored where that shortens the grid."""
    lines = grid_times(trajectory, nodes, first, chord=chord, begun=begun, curved=False)
    curves = grid_times(trajectory, nodes, first, chord=chord, begun=begun)
    short = padded_size(curves.size) < padded_size(lines.size)
    return (curves, True) if short else (lines, False)


def _motion(trajectory: Trajectory, grid: np.ndarray, first: float, curved: bool) -> Motion:
    displacement = path_at(trajectory, grid, first)
    curvature = None
    if curved:
        middle = trajectory.displacement(0.5 * (grid[1:] + grid[:-1]))
        off = middle - 0.5 * (displacement[1:] + displacement[:-1])
        curvature = held(np.append(0.0, np.where(grid[:-1] < first, 0.0, off)))
    velocity, acceleration = trajectory.velocity(grid), trajectory.acceleration(grid)
    return Motion(
        held(grid), held(displacement), held(velocity), held(acceleration), sagitta=curvature
    )


def _remembering(motion: Motion, past: EarlierMotion) -> Motion:
    """Return the motion with the earlier tests before it, at rest between their points."""
    first = np.nextafter(float(motion.time[0]), -np.inf)
    time = held(np.minimum(past.time, first))
    still = np.zeros(time.shape)
    join = lambda x, y: held(np.concatenate([x, y]))  # noqa: E731
    return replace(
        motion,
        time=join(time, motion.time),
        displacement=join(past.displacement, motion.displacement),
        velocity=join(still, motion.velocity),
        acceleration=join(still, motion.acceleration),
        ago=join(past.ago, np.zeros(motion.time.shape, past.ago.dtype)),
        sagitta=None if motion.sagitta is None else join(still, motion.sagitta),
    )


def _average(test: Test, begin: np.ndarray, sd_scale: float) -> Blocks:
    count = np.diff(np.append(begin, test.time.size)).astype(float)
    last = np.append(begin[1:], test.time.size) - 1
    force = np.add.reduceat(test.force, begin) / count
    weight = None
    if test.force_sd is not None:
        weight = np.sqrt(np.add.reduceat((test.force_sd / sd_scale) ** 2, begin) / count)
    return Blocks.of_means(force, count, test.time[begin], test.time[last], weight)


def _with_errors(
    blocks: Blocks, trajectory: Trajectory, centre: np.ndarray, fineness: Fineness
) -> Blocks:
    """Add the noise at each block's force, and the force error that the motion's error makes.

    The stiffness is the record's own slope, no steeper than the pad's steepest.
    """
    force, depth = np.asarray(blocks.force), trajectory.displacement(centre)
    sd = trajectory.displacement_sd(centre)
    stiffness = np.zeros_like(force)
    if force.size > 2:
        rise, travel = np.gradient(force), np.gradient(depth)
        sure = np.maximum(travel**2, np.maximum(_SURE * sd, 1e-9 * np.ptp(depth) + 1e-100) ** 2)
        stiffness = np.abs(rise * travel) / sure
    extra = np.minimum(stiffness, fineness.stiffness) * sd
    return replace(blocks, scale=held(fineness.floor.scale(force)), extra=held(extra))


def _nodes(time: np.ndarray, begin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and sd (both (B,)) of each block's sample times."""
    count = np.diff(np.append(begin, time.size))
    offset = time - np.repeat(time[begin], count)
    mean = np.add.reduceat(offset, begin) / count
    spread = np.add.reduceat((offset - np.repeat(mean, count)) ** 2, begin) / count
    return time[begin] + mean, np.sqrt(spread)
