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
from scipy.ndimage import minimum_filter1d
from scipy.special import ndtr

from qlvbayes.io.arrays import Array, Mask
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
    samples: NDArray[np.intp] | None = None,
    past: EarlierMotion | None = None,
    fineness: Fineness | None = None,
    approached: bool = True,
    errors: bool = False,
) -> Record:
    """Return the record of one test: block means, nodes, and the motion on a grid of times.

    samples: indices of readings, each of which is then a block of its own.
    """
    time, read = test.time, trajectory.read_times(test.time)
    touches = _touches(read, trajectory, test.contact_sd or 0.0)
    edges = block_edges(phases, np.append(trajectory.kinks, touches[0]), time)
    if samples is None:
        doubtful = _doubtful(time, trajectory, phases)
        rows, begin = np.arange(time.size), _beginnings(time, np.union1d(edges, doubtful))
        kept = _outside(time, doubtful)[begin]
    else:
        rows, begin = samples, np.arange(samples.size)
        kept = np.ones(begin.size, dtype=bool)
    # before single samples the motion is as fine as that of the block means
    lead = edges[(edges > time[0]) & (edges < time[rows[0]])]
    centre, half = (x[kept] for x in _nodes(time[rows], begin))
    half = off_kinks(centre, half, time, trajectory)
    nodes = np.stack([centre - half, centre + half])
    blocks = _average(test, rows, begin, kept, sd_scale)
    if fineness is not None:
        moments = time, test.force, begin, trajectory, fineness.floor.white
        timing = held(timing_sd(*moments, rows, touches)[kept])
        scale = held(fineness.floor.scale(np.asarray(blocks.force)))
        extra = held(_force_errors(blocks, trajectory, centre, fineness))
        blocks = replace(blocks, scale=scale, extra=extra, timing=timing)
    chord = np.inf if fineness is None else fineness.chord
    begun = approached and (past is None or not past.stays)
    first = float(read[0])
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
        own = np.isin(time, read)
        wrong = path_errors(time[own], test.displacement[own], trajectory, grid)
    if past is not None:
        motion, indices = _remembering(motion, past), indices + past.time.size
        before = ((0, 0), (past.time.size, 0))
        wrong = jax.tree.map(lambda x: held(np.pad(x, before)), wrong)
    return Record(motion, held(indices), blocks, wrong)


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


def clear_of_kinks(time: Array, trajectory: Trajectory, phases: Sequence[Phase]) -> Mask:
    """Return False (n,) for samples so near a kink that their side of it is unknown."""
    return _outside(time, _doubtful(time, trajectory, phases))


def _outside(time: Array, stretches: Array) -> Mask:
    clear = np.ones(time.size, dtype=bool)
    for low, high in stretches:
        clear &= (time < low) | (time > high)
    return clear


def _doubtful(time: Array, trajectory: Trajectory, phases: Sequence[Phase]) -> Array:
    """Return the stretches (k, 2) around kinks whose times the samples do not determine."""
    time = trajectory.read_times(time)
    kinks, jumps = trajectory.kinks, trajectory.speed_jumps
    if kinks.size > _MOST_KINKS:
        return np.zeros((0, 2))
    if _begins_in_motion(trajectory):
        kinks = np.append(trajectory.knots[:1], kinks)
        jumps = np.append(np.abs(trajectory.start_velocity[:1]), jumps)
    lengths = np.array([phase.stop - phase.start for phase in phases])
    index = np.minimum(np.searchsorted([phase.stop for phase in phases], kinks), lengths.size - 1)
    around = minimum_filter1d(lengths, 3, mode="nearest")[index]
    at = np.clip(np.searchsorted(time, kinks), 1, time.size - 1)
    reach = _MARGIN * (time[at] - time[at - 1])
    spared = reach <= _SPARED * around
    unsure = np.divide(trajectory.resolution, jumps, out=np.zeros(kinks.size), where=jumps > 0.0)
    reach += np.minimum(unsure, _SPARED * around)
    return np.stack([kinks - reach, kinks + reach], axis=1)[spared]


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


def _average(
    test: Test, rows: NDArray[np.intp], begin: NDArray[np.intp], kept: Mask, sd_scale: float
) -> Blocks:
    time, ends = test.time[rows], np.append(begin[1:], rows.size)
    count = (ends - begin).astype(float)
    force = np.add.reduceat(test.force[rows], begin) / count
    weight = np.ones(count.shape)
    if test.force_sd is not None:
        weight = np.sqrt(np.add.reduceat((test.force_sd[rows] / sd_scale) ** 2, begin) / count)
    means = (x[kept] for x in (force, count, time[begin], time[ends - 1], weight))
    blocks = Blocks.of_means(*means)
    return replace(blocks, tare=held(np.full(np.shape(blocks.count), test.tare_sd)))


def _force_errors(
    blocks: Blocks, trajectory: Trajectory, centre: Array, fineness: Fineness
) -> Array:
    """Return the force error (B,) in N that the motion's error makes at each block's centre."""
    force, depth = np.asarray(blocks.force), trajectory.displacement(centre)
    sd = trajectory.displacement_sd(centre)
    stiffness = np.zeros_like(force)
    if force.size > 2:
        rise, travel = np.gradient(force), np.gradient(depth)
        sure = np.maximum(travel**2, np.maximum(_SURE * sd, 1e-9 * np.ptp(depth) + 1e-100) ** 2)
        stiffness = np.abs(rise * travel) / sure
    return np.asarray(np.minimum(stiffness, fineness.stiffness) * sd)


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


def _touches(read: Array, trajectory: Trajectory, contact_sd: float) -> tuple[Array, Array]:
    """Return the moments (k,) in s at which the platen passes the contact, and their sds."""
    way = trajectory.displacement(read)
    before = np.flatnonzero((way[:-1] < 0.0) & (way[1:] >= 0.0))
    step, passed = np.diff(read)[before], np.diff(way)[before]
    at = read[before] - way[before] / passed * step
    return at, np.hypot(_UNRESOLVED, contact_sd / passed) * step


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
    touches: tuple[Array, Array] = (np.zeros(0), np.zeros(0)),
) -> Array:
    r"""Return the sd (B,) in N of block means that uncertain times cause.

    time, force: of all readings (n,); begin: the first of each block (B,), of the readings that
    ``rows`` names where not all are in blocks; touches: when the contact is passed, and the sds.

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
    read, kinks = trajectory.read_times(time), trajectory.kinks
    sds = kink_sds(read, trajectory)
    if _begins_in_motion(trajectory):
        kinks = np.append(trajectory.knots[:1], kinks)
        sds = np.append(_UNRESOLVED * np.diff(read)[:1], sds)
    kinks, sds = np.append(kinks, touches[0]), np.append(sds, touches[1])
    order, kink = np.argsort(kinks, kind="stable"), np.zeros(time.shape)
    if kinks.size:
        nearest = order[_nearest(kinks[order], time)]
        beyond = ndtr(-np.abs(time - kinks[nearest]) / sds[nearest])
        kink = np.sqrt(beyond * (1.0 - beyond)) * jumps
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
