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
from numpy.typing import NDArray
from scipy.special import ndtr

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Test
from qlvbayes.laws.motion import Motion
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.past import EarlierMotion, grid_times, path_at
from qlvbayes.motion.patherrors import path_errors
from qlvbayes.motion.phases import MOVING, Phase
from qlvbayes.motion.record import Blocks, Record, held, padded_size
from qlvbayes.motion.trajectory import Trajectory

GROWTH = 0.2  # a block's width over the time since its phase began
MOVING_BLOCKS = 20  # at least so many in a ramp or unloading,
RESTING_BLOCKS = 8  # and in a hold,
_IN_ALL, _FEWEST = 240, 4  # of a test of a dozen phases; of more, as cycles are, each has fewer
_NEAR = 3  # intervals ahead whose median is the local one
_MOST_KINKS = 40
_MARGIN = 1.2  # sampling intervals either side of a kink that are left out,
_SPARED = 0.03  # if they are at most this share of the phases around it
_EVEN = 1.5  # a gap this much longer than the one next to it ends a block
_SURE = 3.0  # sds of the displacement over which a slope is known
_EXACT = 1e-3  # of a sampling interval: no kink is known better, whatever the record says
_OFF_THE_LINE = 6.0  # variance of twice a reading's distance to its neighbours' line, over its own
_UNRESOLVED = 12.0**-0.5  # sd of a moment anywhere in a sampling interval, over that interval


@dataclass(frozen=True)
class Fineness:
    """Fineness with which a record is to be reduced, given its noise."""

    floor: NoiseFloor  # noise and its growth with the force
    # the pad's largest (N/mm), by which an error of the motion becomes one of the force
    stiffness: float
    # how far the grid's straight lines may be from the motion (mm), where less than the default
    chord: float


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
    """Return the record of one test: block means, nodes, and the motion on a grid of times."""
    whole = whole or test
    begin = np.arange(test.time.size)
    kept = np.ones(begin.size, dtype=bool)
    touches, _ = _touches(trajectory.read_times(whole.time), trajectory)
    edges = block_edges(phases, np.append(trajectory.kinks, touches), whole.time)
    # before single samples the motion is as fine as that of the block means
    lead = edges[(edges > whole.time[0]) & (edges < test.time[0])]
    if blocks:
        doubtful = _doubtful(test.time, trajectory, phases)
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
        moments = whole.time, whole.force, begin, trajectory, white, rows
        timing = timing_sd(*moments, contact_sd=whole.contact_sd or 0.0)[kept]
        averaged = replace(averaged, timing=held(timing))
    chord = np.inf if fineness is None else fineness.chord
    begun = approached and (past is None or not past.stays)
    first = float(trajectory.read_times(whole.time)[0])
    lines, curves = (
        grid_times(
            trajectory, np.union1d(lead, nodes), first, chord=chord, begun=begun, curved=curved
        )
        for curved in (False, True)
    )
    curved = padded_size(curves.size) < padded_size(lines.size)
    grid = curves if curved else lines
    motion = _motion(trajectory, grid, first, curved)
    motion = replace(motion, start=held(np.float64(start)), number=held(np.float64(number)))
    indices = np.searchsorted(grid, nodes).T
    wrong = None
    if errors:
        read = np.isin(whole.time, trajectory.read_times(whole.time))
        wrong = path_errors(whole.time[read], whole.displacement[read], trajectory, grid)
    if past is not None:
        motion, indices = _remembering(motion, past), indices + past.time.size
        before = ((0, 0), (past.time.size, 0))
        wrong = jax.tree.map(lambda rows: held(np.pad(rows, before)), wrong)
    return Record(motion, held(indices), averaged, wrong)


def block_edges(phases: Sequence[Phase], kinks: Array, time: Array) -> Array:
    """Return the times at which blocks begin and end; none crosses a phase's end or a kink (k,).

    Within a phase the spacing grows with the time since it began. It is twice the interval between
    the first readings at least, of those at times (n,) in s, or less where a record is twice as
    dense.
    """
    apart = 2.0 * np.diff(time)
    shortest = float(np.median(apart[:200]))
    moving = max(min(MOVING_BLOCKS, _IN_ALL // len(phases)), _FEWEST)
    resting, growth = min(RESTING_BLOCKS, moving), GROWTH * MOVING_BLOCKS / moving
    edges = [np.array([phases[0].start])]
    for phase in phases:
        length = phase.stop - phase.start
        longest = length / (moving if phase.kind in MOVING else resting)
        own = [0.0]
        while own[-1] < length:
            at = int(np.searchsorted(time, phase.start + own[-1]))
            near = float(np.median(apart[at : at + _NEAR])) if at < apart.size else shortest
            least = near if near < 0.5 * shortest else shortest
            own.append(own[-1] + min(max(growth * own[-1], least), max(longest, least)))
        edges.append(phase.start + np.array([*own[1:-1], length]))
    if kinks.size <= _MOST_KINKS:
        edges.append(kinks)
    return np.unique(np.concatenate(edges))


def _beginnings(time: Array, edges: Array) -> NDArray[np.intp]:
    """Return the first sample of each block: at an edge, and after a gap in even spacing.

    Where intervals of several lengths alternate, as those of merged clocks do, none is a gap.
    """
    owner = np.searchsorted(edges, time, side="right")
    gap = np.diff(time)
    around = np.pad(gap, _NEAR, mode="edge")
    every = np.lib.stride_tricks.sliding_window_view(around, _NEAR)[: gap.size + _NEAR + 1]
    nearby = np.median(every, axis=1)
    before, after = np.append(gap[:1], gap[:-1]), np.append(gap[1:], gap[-1:])
    uneven = gap > _EVEN * np.minimum(before, after)
    uneven &= gap > _EVEN * np.minimum(nearby[: gap.size], nearby[_NEAR + 1 :])
    return np.flatnonzero(np.concatenate([[True], (np.diff(owner) > 0) | uneven]))


def clear_of_kinks(time: Array, trajectory: Trajectory, phases: Sequence[Phase]) -> Array:
    """Return False (n,) for samples so near a kink that their side of it is unknown."""
    clear = np.ones(time.size, dtype=bool)
    for low, high in _doubtful(time, trajectory, phases):
        clear &= (time < low) | (time > high)
    return clear


def _doubtful(
    time: Array, trajectory: Trajectory, phases: Sequence[Phase]
) -> list[tuple[float, float]]:
    """Return the stretches around kinks whose times the samples do not determine."""
    time = trajectory.read_times(time)
    kinks, jumps = trajectory.kinks, trajectory.speed_jumps
    if kinks.size > _MOST_KINKS:
        return []
    if _begins_in_motion(trajectory):
        kinks = np.append(trajectory.knots[:1], kinks)
        jumps = np.append(np.abs(trajectory.start_velocity[:1]), jumps)
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


def _begins_in_motion(trajectory: Trajectory) -> bool:
    return bool(trajectory.start_velocity[0] or trajectory.start_acceleration[0])


def _motion(trajectory: Trajectory, grid: Array, first: float, curved: bool) -> Motion:
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
    still, none = np.zeros(past.time.shape), np.zeros(motion.time.shape, past.ago.dtype)
    before = {
        "time": (np.minimum(past.time, first), motion.time),
        "displacement": (past.displacement, motion.displacement),
        "velocity": (still, motion.velocity),
        "acceleration": (still, motion.acceleration),
        "ago": (past.ago, none),
    }
    if motion.sagitta is not None:
        before["sagitta"] = (still, motion.sagitta)
    return replace(motion, **{name: held(np.concatenate(x)) for name, x in before.items()})


def _average(test: Test, begin: NDArray[np.intp], sd_scale: float) -> Blocks:
    count = np.diff(np.append(begin, test.time.size)).astype(float)
    last = np.append(begin[1:], test.time.size) - 1
    force = np.add.reduceat(test.force, begin) / count
    weight = None
    if test.force_sd is not None:
        weight = np.sqrt(np.add.reduceat((test.force_sd / sd_scale) ** 2, begin) / count)
    blocks = Blocks.of_means(force, count, test.time[begin], test.time[last], weight)
    return replace(blocks, tare=held(np.full(count.shape, test.tare_sd)))


def _with_errors(
    blocks: Blocks, trajectory: Trajectory, centre: Array, fineness: Fineness
) -> Blocks:
    """Add the noise at each block's force, and the force error that the motion's error makes."""
    force, depth = np.asarray(blocks.force), trajectory.displacement(centre)
    sd = trajectory.displacement_sd(centre)
    stiffness = np.zeros_like(force)
    if force.size > 2:
        rise, travel = np.gradient(force), np.gradient(depth)
        sure = np.maximum(travel**2, np.maximum(_SURE * sd, 1e-9 * np.ptp(depth) + 1e-100) ** 2)
        stiffness = np.abs(rise * travel) / sure
    extra = np.minimum(stiffness, fineness.stiffness) * sd
    return replace(blocks, scale=held(fineness.floor.scale(force)), extra=held(extra))


def _nodes(time: Array, begin: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return mean and sd (both (B,)) of each block's sample times."""
    count = np.diff(np.append(begin, time.size))
    offset = time - np.repeat(time[begin], count)
    mean = np.add.reduceat(offset, begin) / count
    spread = np.add.reduceat((offset - np.repeat(mean, count)) ** 2, begin) / count
    return time[begin] + mean, np.sqrt(spread)


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


def _touches(read: Array, trajectory: Trajectory, contact_sd: float = 0.0) -> tuple[Array, Array]:
    """Return the moments (k,) in s at which the platen passes the contact, and their sds."""
    way = trajectory.displacement(read)
    before = np.flatnonzero((way[:-1] < 0.0) & (way[1:] >= 0.0))
    step, passed = np.diff(read)[before], np.diff(way)[before]
    at = read[before] - way[before] / passed * step
    return at, np.hypot(_UNRESOLVED, contact_sd / passed) * step


def _moment_doubt(time: Array, trajectory: Trajectory, contact_sd: float) -> Array:
    """Return (p (1 - p))^1/2 of each reading at times (n,) in s, by the nearest kink or contact."""
    read = trajectory.read_times(time)
    kinks, sds = trajectory.kinks, kink_sds(read, trajectory)
    if _begins_in_motion(trajectory):
        kinks = np.append(trajectory.knots[:1], kinks)
        sds = np.append(_UNRESOLVED * np.diff(read)[:1], sds)
    touches, doubts = _touches(read, trajectory, contact_sd)
    order = np.argsort(np.append(kinks, touches), kind="stable")
    kinks, sds = np.append(kinks, touches)[order], np.append(sds, doubts)[order]
    if not kinks.size:
        return np.zeros(time.shape)
    nearest = _nearest(kinks, time)
    beyond = ndtr(-np.abs(time - kinks[nearest]) / sds[nearest])
    return np.asarray(np.sqrt(beyond * (1.0 - beyond)))


def _nearest(kinks: Array, at: Array) -> NDArray[np.intp]:
    """Return the index (n,) of the nearest of the sorted kinks (k,) to each time."""
    return np.searchsorted(0.5 * (kinks[1:] + kinks[:-1]), at)


def timing_sd(
    time: Array,
    force: Array,
    begin: NDArray[np.intp],
    trajectory: Trajectory,
    white: float,
    rows: NDArray[np.intp] | None = None,
    *,
    contact_sd: float = 0.0,
) -> Array:
    r"""Return the sd (B,) in N of block means that uncertain times cause.

    A reading at a distance d from a kink of the motion, or from the contact, where what acts on the
    specimen alone begins, of which both together are known to within sigma, lies beyond it with the
    probability p = Phi(-d / sigma). Where the force jumps by Delta F there, whatever made it jump,
    the reading has the additional variance

    .. math:: p (1 - p)\, \Delta F^2

    and a clock that is known to within sigma_c adds (sigma_c dF/dt)^2 to every reading. Jump
    and slope are the record's own: how far a reading is off the line through the readings on
    either side, beyond what their noise makes of it, and the slope of that line.
    """
    jumps = np.abs(np.diff(force, append=force[-1:]))  # at the ends the change to the next one
    if time.size > 2:
        step = np.diff(time)
        line = (force[:-2] * step[1:] + force[2:] * step[:-1]) / (step[1:] + step[:-1])
        jumps[1:-1] = 2.0 * np.abs(force[1:-1] - line)
        jumps[-1] = abs(force[-1] - force[-2])
    jumps = np.sqrt(np.maximum(jumps**2 - _OFF_THE_LINE * white**2, 0.0))
    kink = _moment_doubt(time, trajectory, contact_sd) * jumps
    clock = (trajectory.clock_sd * np.gradient(force, time)) ** 2
    if rows is not None:
        kink, clock = kink[rows], clock[rows]
    count = np.diff(np.append(begin, kink.size))
    kinks, clocks = np.add.reduceat(kink, begin), np.add.reduceat(clock, begin)
    return np.asarray(np.sqrt(kinks**2 + clocks) / count)


def off_kinks(centre: Array, half: Array, time: Array, trajectory: Trajectory) -> Array:
    """Return half the distance (B,) in s of a block's two nodes, neither of them at a kink."""
    kinks = trajectory.kinks
    if not kinks.size:
        return half
    least = _EXACT * _intervals(centre, time)
    apart = np.abs(centre - kinks[_nearest(kinks, centre)])
    inside = np.minimum(centre - time[0], time[-1] - centre) > least
    return np.where((apart < least) & inside, np.maximum(half, least), half)
