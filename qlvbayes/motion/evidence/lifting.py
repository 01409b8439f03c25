"""Direct evidence from platens that move back: adhesion, or a bond, and friction of the guide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    AROUND,
    AT_ZERO,
    CLEAR,
    HALF,
    REACHED,
    DirectEvidence,
    Level,
    Place,
    Rows,
    level_of,
    mean_speed,
    moves_of,
    pooled,
    rows_between,
    told,
)
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.falling import speed_changes
from qlvbayes.motion.phases import Phase

_NEAR = 3  # readings about a change of the speed, where a moved mass pulls
_SLOW = 0.1  # of the largest acceleration, below which a mass pulls little
_LEAST = 0.02  # of the peak: a smaller pull may be a tare that wanders
_FLAT = 0.25  # power of the speed, below which a force does not depend on it: drags have 0.5 to 1
_AFTER = 0.1  # of a rest: a lag or a ringing is over,
_LATE = 0.8  # and where the end of it begins
_END = 0.2  # of a movement, at its end
_LASTS = 20  # readings that are one long place
_SETTLED = 0.2  # of a friction, by which the force may differ before and after the stop
_AGREE = 1.5  # largest ratio of one friction in two tests


def adhesion_seen(experiment: Experiment) -> Iterator[DirectEvidence]:
    """Yield the evidence of a force of the other sign after contact.

    It counts from the lowest of the file's zero and what the test shows before the contact and at
    its end, so that a tare that is off or a guide that rubs is none. A drag pulls too, by a power
    of the speed, and no longer when the platen rests; it is there at once as the platen moves back.
    A pull is beyond doubt where it lasts at rest, does not grow with the speed, or comes gradually.
    """
    least = _LEAST * experiment.peak
    moving, resting, gradual, lasts = [], [], 0, False
    for trial in experiment.trials:
        for move, rest in _unloadings(trial):
            pulls, late = _pulls(experiment, trial, move, rest)
            if pulls is None:
                continue
            if pulls.is_clear and pulls.value > least:
                moving.append(pulls)
                gradual += not _comes_at_once(experiment, pulls, move)
            if late is not None and late.is_clear and late.value > least:
                resting.append(late)
                lasts |= _early(trial, rest).size >= _LASTS
    if not resting and not moving:
        return
    power = _exponent(moving)
    speedless = power is not None and power[0] + 2.0 * power[1] < _FLAT and power[0] > -1.0
    at_rest = len(resting) > 1 or lasts
    places = resting if at_rest or not moving else moving
    largest = max(places, key=lambda one: one.value)
    low, high, unit = min(one.value for one in places), largest.value, experiment.units.force
    why = "which a drag or a film may also do"
    sure = at_rest or speedless or gradual > 1
    if sure:
        how = "goes on while the platen rests" if at_rest else "does not grow with the speed"
        how = how if at_rest or speedless else "comes gradually as the platen moves back"
        why = f"and it {how}: it sticks, or it is bonded"
    sizes = plain(high) if low == high else f"{plain(low)} to {plain(high)}"
    tests = len({one.trial.name for one in places})
    yield told(
        "adhesion", "pull after contact", Level(high, largest.sd), unit, places,
        f"after contact the specimen pulls by {sizes} {unit} (error {plain(largest.sd, 2)}) in "
        f"{tests} of {len(experiment.trials)} tests, {why}", sure,
    )  # fmt: skip


def _pulls(
    experiment: Experiment, trial: Trial, move: Phase, rest: Phase
) -> tuple[Place | None, Place | None]:
    """Return what a movement back pulls by, and the rest after it."""
    path, test = trial.trajectory, trial.test
    slow = np.abs(path.acceleration(test.time)) <= _SLOW * path.top_acceleration
    steady = slow & ~speed_changes(test, path, _NEAR)
    late = rest.start + _LATE * (rest.stop - rest.start)
    end = level_of(experiment, trial, rows_between(trial, late, rest.stop))
    rows = rows_between(trial, move.start, move.stop)
    rows = rows[steady[rows]]
    if end is None or rows.size < AROUND:
        return None, None
    # a specimen that is still pressed at the end has its own zero in the file's
    zeros = (_before(experiment, trial), end, _flat(experiment, trial, move, rest))
    zero = min((one for one in zeros if one is not None), default=end)
    zero = min(zero, Level(0.0, experiment.floor.ou))
    means = np.convolve(test.force[rows], np.full(AROUND, 1.0 / AROUND), mode="valid")
    lowest = int(np.argmin(means))
    found: list[Place | None] = []
    for kind, some in (
        (move.kind, rows[lowest : lowest + AROUND]),
        (rest.kind, _early(trial, rest)),
    ):
        level = level_of(experiment, trial, some)
        sd = 0.0 if level is None else float(np.hypot(level.sd, zero.sd))
        speed = mean_speed(trial, move)
        found.append(level and Place(trial, kind, zero.value - level.value, sd, speed))
    return found[0], found[1]


def _comes_at_once(experiment: Experiment, pull: Place, move: Phase) -> bool:
    """Return whether the force falls by half of a pull until the movement has its speed."""
    trial = pull.trial
    rows = rows_between(trial, move.start, move.stop)
    fast = np.abs(trial.trajectory.velocity(trial.test.time[rows])) >= REACHED * pull.speed
    before = np.arange(max(int(rows[0]) - AROUND, 0), int(rows[0]))
    level = level_of(experiment, trial, before)
    if level is None or not np.any(fast):
        return True
    fall = level.value - float(trial.test.force[rows[int(np.argmax(fast))]])
    return fall + 2.0 * float(np.hypot(level.sd, experiment.floor.total)) > HALF * pull.value


def friction_seen(experiment: Experiment) -> Iterator[DirectEvidence]:
    """Yield the evidence of a force that turns with the direction, at any speed.

    Where a platen has moved back, the force is flat at the end of the movement, the same after the
    stop, and lower than before the contact. A drag ends with the motion; a specimen that pulls
    lets go, or relaxes.
    """
    places = []
    for trial in experiment.trials:
        before = _before(experiment, trial)
        for move, rest in _unloadings(trial) if before is not None else ():
            level = _flat(experiment, trial, move, rest)
            if level is not None and before is not None:
                sd = float(np.hypot(before.sd, level.sd))
                places.append(Place(trial, move.kind, before.value - level.value, sd))
    places = [one for one in places if one.is_clear]
    if len(places) < 2:
        return
    values = [one.value for one in places]
    found, unit = pooled(places), experiment.units.force
    yield told(
        "friction", "force on the way back, and at rest after it", found, unit, places,
        f"off the specimen the force stays {plain(found.value)} +- {plain(found.sd, 2)} {unit} "
        "below that before the contact, as the platen moves back and at rest: something rubs",
        max(values) < _AGREE * min(values) and found.value > CLEAR * found.sd,
    )  # fmt: skip


def _flat(experiment: Experiment, trial: Trial, move: Phase, rest: Phase) -> Level | None:
    """Return the force at the end of a movement and in the rest after it, if it is one force.

    A specimen that pulls changes its force with the depth, and one that has let go has none. At the
    end of a long rest a specimen may come back to the platen.
    """
    steady = ~speed_changes(trial.test, trial.trajectory, _NEAR)
    moving = rows_between(trial, move.stop - _END * (move.stop - move.start), move.stop)
    parts = (*np.array_split(moving[steady[moving]], 2), _early(trial, rest))
    levels = [level_of(experiment, trial, rows) for rows in parts]
    known = [one for one in levels if one is not None]
    if len(known) < len(levels):
        return None
    off = _SETTLED * abs(known[-1].value) + 3.0 * max(one.sd for one in known)
    return known[-1] if np.ptp([one.value for one in known]) <= off else None


def _unloadings(trial: Trial) -> list[tuple[Phase, Phase]]:
    """Return the movements back that a rest follows, and it."""
    return [
        (move, rest)
        for move, rest in moves_of(trial)
        if move.kind == "unload" and move.control == Control.DISPLACEMENT and rest is not None
    ]


def _early(trial: Trial, rest: Phase) -> Rows:
    """Return the readings of a rest after a lag or a ringing is over."""
    tenth = _AFTER * (rest.stop - rest.start)
    return rows_between(trial, rest.start + tenth, rest.start + 2.0 * tenth)


def _before(experiment: Experiment, trial: Trial) -> Level | None:
    """Return the force before the platen first moves."""
    first = next((phase for phase in trial.phases if phase.kind == "ramp"), None)
    if first is None or first.control != Control.DISPLACEMENT:
        return None
    path, test = trial.trajectory, trial.test
    start, depth = path.displacement(np.array([test.time[0], first.stop]))
    if abs(start) > AT_ZERO * experiment.depth:
        return None
    still = max(2.0 * path.resolution, 1e-3 * abs(depth - start))
    left = np.flatnonzero(np.abs(path.displacement(test.time) - start) > still)
    return level_of(experiment, trial, np.arange(left[0] if left.size else test.time.size))


def _exponent(places: Sequence[Place]) -> tuple[float, float] | None:
    """Return by which power of the speed a quantity grows, and its error.

    None where the speeds do not differ by a factor of two.
    """
    if len(places) < 2 or np.ptp(speeds := np.log([one.speed for one in places])) < np.log(2.0):
        return None
    sizes = np.log([one.value for one in places])
    weights = np.array([one.value / one.sd for one in places])
    line, covariance = np.polyfit(speeds, sizes, 1, w=weights, cov="unscaled")
    return float(line[0]), float(np.sqrt(covariance[0, 0]))
