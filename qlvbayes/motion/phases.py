"""Division of a motion into ramps, holds, unloadings and recoveries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Control, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.io.wording import plain
from qlvbayes.motion.trajectory import Trajectory

Move = tuple[int, int, int]  # first and last of the times, and the sign
Kind = Literal["ramp", "hold", "unload", "recovery"]
# of kinds, for readers
NAMES = {"ramp": "ramp", "hold": "hold", "unload": "unloading", "recovery": "recovery"}
KINDS = tuple(NAMES)
MOVING = ("ramp", "unload")  # there and back

_LEAST_SHARE = 0.01  # of the stroke: a smaller movement is drift or jitter
_LEAST_STEPS = 5.0  # encoder steps, for the same reason
_CREEP = 0.02  # of a movement's own speed: slower ends of it belong to the rest
_DWELL = 0.2  # of the shorter movement next to it: a longer slow turn is a dwell
_SETTLING = 0.1  # of a movement: what follows it at once and is smaller is the platen settling,
_REST = 4.0  # if the rest after it lasts so many times as long,
_LATE = 10.0  # and it is over within so many times the movement's duration
_CREPT = 0.05  # of a movement: what follows it at once and is smaller is the platen creeping,
_SLOW = 0.1  # if it has at most so much of the movement's mean speed,
_EARLY = 0.4  # half of it is over in so much of its duration, where a steady speed takes 0.5,
_LARGER = 2.0  # and the next movement is so many times as large: small cycles do not creep
_FEWEST_AT_REST = 3  # readings that show a rest,
_FEWEST_MOVING = 2  # and a movement
_WORTH = 4.5  # median intervals between readings, for which a dwell before the first movement
_SHARE = 0.1  # of that movement's duration is a hold
_ROUNDING = 1e-12  # of the record's duration
_LEAST_SPEED = 1e-4  # of the record's top speed
_DIGITS = 4  # of a displacement: a machine's position has a large part that is no depth


@dataclass(frozen=True)
class Phase:
    """A phase from ``start`` to ``stop`` (s), in which ``control`` was prescribed.

    ``ramp``: moving toward greater depth; ``hold``: at rest, also before the first movement;
    ``unload``: moving back; ``recovery``: at rest after an unload. Where the force was prescribed
    it is the force that rises, rests and falls.
    """

    kind: Kind
    start: float
    stop: float
    control: Control = Control.DISPLACEMENT


def phase_name(kind: str, control: str) -> str:
    """Return the name of a phase for readers, by its kind and by what was prescribed in it."""
    constant = kind not in MOVING and control == Control.FORCE
    return f"{NAMES[kind]} at constant force" if constant else NAMES[kind]


def span(seconds: float) -> str:
    """Format a time with two digits, as '16 ms', '0.8 s', '30 s'."""
    return f"{plain(1e3 * seconds, 2)} ms" if seconds < 0.0995 else f"{plain(seconds, 2)} s"


def find_phases(trajectory: Trajectory) -> tuple[Phase, ...]:
    """Return the phases of a record: contiguous, in order of time, from its start to its end."""
    times, depth = _turning_points(trajectory)
    moves = _settled(_movements(times, depth, trajectory.resolution), times, trajectory)
    moves = _turning(_from_the_start(moves, times, trajectory), times, trajectory)
    phases: list[Phase] = []
    resting: Kind = "hold"
    at = float(times[0])
    for first, last, sign in moves:
        begin, end = float(times[first]), float(times[last])
        if begin > at:
            phases.append(Phase(resting, at, begin))
        phases.append(Phase("ramp" if sign > 0 else "unload", begin, end))
        at, resting = end, "hold" if sign > 0 else "recovery"
    if at < times[-1]:
        phases.append(Phase(resting, at, float(times[-1])))
    return tuple(_shown(phases, trajectory))


def _settled(moves: list[Move], times: Array, trajectory: Trajectory) -> list[Move]:
    """Return the movements without the small ones in which a platen settles after a larger one."""
    depth = trajectory.displacement(times)
    sizes = np.array([abs(depth[last] - depth[first]) for first, last, _ in moves])
    durations = np.array([times[last] - times[first] for first, last, _ in moves])
    kept: list[Move] = []
    k = 0
    while k < len(moves):
        kept.append(moves[k])
        last, run, creeping = moves[k][1], k + 1, False
        while run < len(moves) and not creeping:
            pause = times[moves[run][0]] - times[moves[run - 1][1]]
            if sizes[run] >= _SETTLING * sizes[k] or pause > _DWELL * durations[run]:
                break
            # a creep is small and slow, most of it at its beginning, and no small cycles follow
            slow = sizes[run] * durations[k] <= _SLOW * sizes[k] * durations[run]
            alone = np.all(sizes[run + 1 : run + 2] >= _LARGER * sizes[run])
            begin, end = times[list(moves[run][:2])]
            start, early, stop = trajectory.displacement(
                [begin, begin + _EARLY * (end - begin), end]
            )
            early_on = abs(early - start) >= 0.5 * abs(stop - start)
            creeping = bool(slow and alone and early_on and sizes[run] < _CREPT * sizes[k])
            run += 1
        settled = times[moves[run - 1][0 if creeping else 1]]  # a creep is a part of the rest
        after = (times[moves[run][0]] if run < len(moves) else times[-1]) - settled
        lasted = settled - times[last]
        k = run if _REST * lasted <= after and lasted <= _LATE * durations[k] else k + 1
    return kept


def _shown(phases: list[Phase], trajectory: Trajectory) -> list[Phase]:
    """Return the phases without those of too few readings, which join their neighbours."""
    read, k = trajectory.read_at, 0
    while read is not None and len(phases) > 1 and k < len(phases):
        here = phases[k]
        if _is_shown(here, trajectory, read):
            k += 1
        elif k == 0:
            phases = [replace(phases[1], start=here.start), *phases[2:]]
        else:
            before, rest = replace(phases[k - 1], stop=here.stop), phases[k + 1 :]
            if rest and (rest[0].kind == before.kind or before.kind not in MOVING):
                before, rest = replace(before, stop=rest[0].stop), rest[1:]
            phases = [*phases[: k - 1], before, *rest]
            k -= 1
    return phases


def _is_shown(phase: Phase, trajectory: Trajectory, read: Array) -> bool:
    """Return whether enough readings lie in a phase; a large movement needs none."""
    count = np.count_nonzero((read >= phase.start - 1e-9) & (read <= phase.stop + 1e-9))
    if phase.kind not in MOVING:
        return bool(count >= _FEWEST_AT_REST)
    begin, end = trajectory.displacement([phase.start, phase.stop])
    stroke = float(np.ptp(trajectory.displacement(trajectory.knots)))
    return bool(count >= _FEWEST_MOVING or abs(end - begin) > _SETTLING * stroke)


def phase_index(phases: Sequence[Phase], time: Array) -> NDArray[np.intp]:
    """Return the index (N,) of the phase at each time (N,); the first one's before it begins."""
    return np.searchsorted([phase.start for phase in phases[1:]], time, side="right")


def loading_rate(trajectory: Trajectory, phases: tuple[Phase, ...]) -> float:
    """Return the mean speed of the first ramp between 20 and 80 % of its stroke (mm/s)."""
    ramp = next((p for p in phases if p.kind == "ramp"), None)
    if ramp is None:
        raise InputError("the record holds no loading ramp")
    t = np.linspace(ramp.start, ramp.stop, 4001)
    depth = np.maximum.accumulate(trajectory.displacement(t))
    stroke = float(depth[-1] - depth[0])
    early, late = np.interp(depth[0] + np.array([0.2, 0.8]) * stroke, depth, t)
    return 0.6 * stroke / float(late - early)


def _turning_points(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return knots and reversals with their depth: the motion is monotone between two of them."""
    times = np.unique(np.concatenate([trajectory.knots, trajectory.turning_points]))
    least = _ROUNDING * float(times[-1] - times[0])
    apart = (np.diff(times[:-1]) > least) & (times[-1] - times[1:-1] > least)
    times = times[np.concatenate([[True], apart, [True]])]
    return times, trajectory.displacement(times)


def _from_the_start(moves: list[Move], times: Array, trajectory: Trajectory) -> list[Move]:
    """Let the first movement begin with the record if the dwell before it is shorter."""
    if not moves:
        return moves
    first, last, sign = moves[0]
    dwell, lasted = times[first] - times[0], times[last] - times[first]
    late = dwell < lasted
    if late and trajectory.read_at is not None and first > 0:
        interval = float(np.median(np.diff(trajectory.read_at)))
        still = np.all(_at_rest(trajectory, times[: first + 1]))
        late = not (still and dwell >= max(_SHARE * lasted, _WORTH * interval))
    return [(0, last, sign), *moves[1:]] if late else moves


def _turning(moves: list[Move], times: Array, trajectory: Trajectory) -> list[Move]:
    """Join opposite movements where they turn, unless the platen rested there for long."""
    joined = moves[:1]
    for first, last, sign in moves[1:]:
        before, end, direction = joined[-1]
        pause = times[first] - times[end]
        shorter = min(times[end] - times[before], times[last] - times[first])
        meeting = direction != sign and first > end and pause < _DWELL * shorter
        between = times[end : first + 1]
        if meeting and not np.any(_at_rest(trajectory, between)):
            first = end + int(np.argmax(direction * trajectory.displacement(between)))
            joined[-1] = (before, first, direction)
        joined.append((first, last, sign))
    if joined and not np.any(_at_rest(trajectory, times[joined[-1][1] :])):
        first, last, sign = joined[-1]
        if times[-1] - times[last] < _DWELL * (times[last] - times[first]):
            joined[-1] = (first, times.size - 1, sign)
    return joined


def _at_rest(trajectory: Trajectory, times: Array) -> NDArray[np.bool_]:
    """Return between which of these neighbouring times the platen is at rest."""
    return trajectory.velocity(0.5 * (times[1:] + times[:-1])) == 0.0


def _movements(times: Array, depth: Array, resolution: float) -> list[Move]:
    """Return (first, last, sign) of the movements, as indices of ``times``."""
    stroke = float(np.ptp(depth))
    if stroke == 0.0:
        return []
    least = max(_LEAST_SHARE * stroke, _LEAST_STEPS * resolution)
    speed = np.abs(np.diff(depth)) / np.diff(times)
    moves = []
    for first, last, sign in _swings(depth, least):
        moves += [
            (a, b, sign)
            for a, b in _between_pauses(times, depth, first, last, least)
            if abs(depth[b] - depth[a]) >= least
            and abs(depth[b] - depth[a]) > _LEAST_SPEED * speed.max() * (times[b] - times[a])
        ]
    return moves


def _swings(depth: Array, least: float) -> list[Move]:
    """Return alternating rises and falls of at least ``least``; smaller reversals are ignored."""
    swings: list[Move] = []
    low = high = pivot = extreme = sign = 0
    for i, d in enumerate(depth):
        if sign == 0:
            low, high = (i if d < depth[low] else low), (i if d > depth[high] else high)
            if depth[high] - depth[low] >= least:
                sign, pivot = (1, low) if high == i else (-1, high)
                extreme = i
        elif sign * (d - depth[extreme]) > 0.0:
            extreme = i
        elif sign * (depth[extreme] - d) >= least:
            swings.append((pivot, extreme, sign))
            sign, pivot, extreme = -sign, extreme, i
    if sign:
        swings.append((pivot, extreme, sign))
    return swings


def _between_pauses(
    times: Array, depth: Array, first: int, last: int, least: float
) -> list[tuple[int, int]]:
    """Divide a swing at its pauses and leave out its slow ends."""
    steps = np.abs(np.diff(depth[first : last + 1]))
    gaps = np.diff(times[first : last + 1])
    quick = steps / gaps
    # Speed at which most of the distance is covered.
    order = np.argsort(quick)
    covered = np.cumsum(steps[order])
    typical = float(quick[order][np.searchsorted(covered, 0.05 * covered[-1])])
    moving = quick > _CREEP * typical
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
    runs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    joined = [runs[0]]
    for a, b in runs[1:]:
        pause = gaps[joined[-1][1] : a].sum()
        if pause < least / typical:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    return [(first + a, first + b) for a, b in joined]


def no_ramp(
    test: Test, trajectory: Trajectory, phases: Sequence[Phase], units: UnitSystem
) -> InputError:
    """Return the error that names a test without a ramp, what it does, and a remedy."""
    word, force = units.displacement_name, units.force_name
    unit = "" if units.dimensionless else f" {units.displacement}"
    falls = [phase for phase in phases if phase.kind == "unload"]
    if not falls:
        seen = f"its {word} changes by {plain(float(np.ptp(test.displacement)), 2)}{unit} only"
        remedy = "add the rows of the ramp before this hold, or delete the test"
    else:
        ends = trajectory.displacement([falls[0].start, falls[-1].stop])
        start, stop = (plain(float(end), _DIGITS) for end in ends)
        seen = f"its {word} only falls, from {start} to {stop}{unit}"
        inside = (test.time >= falls[0].start) & (test.time <= falls[0].stop)
        displacement = test.displacement[inside]
        if (displacement - np.mean(displacement)) @ test.force[inside] < 0.0:
            seen += f", while the {force} rises, so that it counts the wrong way"
            remedy = f"write its value at first contact minus each value as {word}, so that "
            remedy += "pressing makes it rise from zero"
        else:
            seen += f", and the {force} falls with it"
            remedy = f"add the rows of the loading before it, multiply {word} and {force} by -1 if "
            remedy += "this is the loading, or delete the test"
    what = f"test {test.name} of pad {test.pad} holds no loading ramp: {seen}"
    return InputError(what, remedy=remedy)
