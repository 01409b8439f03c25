"""Direct evidence from platens that move back: adhesion, or a bond, and friction of the guide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.io.arrays import Mask
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.record import (
    CLEAR,
    FEWEST,
    WANDERS,
    DirectEvidence,
    Level,
    Place,
    Rows,
    exponent,
    level_before,
    level_of,
    mean_speed,
    moves_of,
    names_of,
    pooled,
    rows_between,
)
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.falling import speed_changes
from qlvbayes.motion.phases import Phase

_WIDTH = 5  # readings whose mean is a force
_NEAR = 3  # readings about a change of the speed, where a moved mass pulls
_SLOW = 0.1  # of the largest acceleration, below which a mass pulls little
_FLAT = 0.25  # power of the speed, below which a force does not depend on it: drags have 0.5 to 1
_AFTER = 0.1  # of a rest: a lag or a ringing is over,
_LATE = 0.8  # and where the end of it begins
_HALF = 0.5  # of a pull, by which a drag falls at once as the movement begins
_REACHED = 0.9  # of the mean speed, at which it has begun
_LASTS = 20  # readings that are one long place
_SETTLED = 0.2  # of a friction, by which the force may differ before and after the stop
_AGREE = 1.5  # largest ratio of one friction in two tests
_END = 0.2  # of a movement, at its end or its beginning
_BEGUN = 0.05  # of a movement, after which what rubs has yielded


@dataclass(frozen=True)
class Lift:
    """A movement back: what it pulls by as it moves, and at rest after it."""

    moving: Place
    resting: Place | None
    lasts: bool  # whether the pull at rest is that of many readings
    comes_at_once: bool  # whether the force falls by half of the pull as the movement begins


def adhesion_seen(experiment: Experiment, *, bonded: bool) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force of the other sign after contact; empty for bonded pads.

    It counts from the lowest of the file's zero and what the test shows before the contact, on the
    way in and at its end, so that a tare that is off, a drive that ripples or a guide that rubs is
    none; what any test shows to rub on the way in, rubs on the way back of all. A drag pulls too,
    by a power of the speed, and no longer when the platen rests; it is there at once as the platen
    moves back, as a film is, which is thinnest at the greatest depth. A pull is beyond doubt where
    it lasts at rest, does not grow with the speed, or comes gradually, in most tests that move
    back: what is sticky sticks in all of them.
    """
    if bonded or experiment.units.dimensionless:
        return ()
    inward = [one for one in _every_inward(experiment) if one.is_clear]
    rubs = Level(*pooled(inward)) if inward else Level(0.0, 0.0)
    lifts = [lift for trial in experiment.trials for lift in _lifts(experiment, trial, rubs)]
    back = {one.moving.trial.name for one in lifts}
    least = WANDERS * experiment.peak
    resting = [
        (one.resting, one.lasts)
        for one in lifts
        if one.resting is not None and one.resting.is_clear and one.resting.value > least
    ]
    pulling = [one for one in lifts if one.moving.is_clear and one.moving.value > least]
    moving = [one.moving for one in pulling]
    gradual = sum(not one.comes_at_once for one in pulling) > 1
    if not resting and not moving:
        return ()
    power = exponent(moving) if len(moving) > 1 else None
    speedless = power is not None and power[0] + 2.0 * power[1] < _FLAT and power[0] > -1.0
    at_rest = len(resting) > 1 or any(lasts for _, lasts in resting)
    places = [one for one, _ in resting] if at_rest else moving or [one for one, _ in resting]
    largest = max(places, key=lambda one: one.value)
    low, high = min(one.value for one in places), largest.value
    unit = experiment.units.force
    why = "which a drag or a film may also do"
    if at_rest:
        why = "and it goes on while the platen rests: it sticks, or it is bonded"
    elif speedless:
        why = "and it does not grow with the speed: it sticks, or it is bonded"
    elif gradual:
        why = "and it comes gradually as the platen moves back: it sticks, or it is bonded"
    tests, phases = names_of(places)
    sizes = plain(high) if low == high else f"{plain(low)} to {plain(high)}"
    return (
        DirectEvidence(
            "adhesion", "pull after contact", high, largest.sd, unit, tests, phases,
            f"after contact the specimen pulls by {sizes} {unit} (error {plain(largest.sd, 2)}) in "
            f"{len(tests)} of {len(experiment.trials)} tests, {why}",
            (at_rest or speedless or gradual) and 2 * len(tests) > len(back),
        ),
    )  # fmt: skip


def _lifts(experiment: Experiment, trial: Trial, rubs: Level) -> list[Lift]:
    path, test = trial.trajectory, trial.test
    slow = np.abs(path.acceleration(test.time)) <= _SLOW * path.top_acceleration
    steady = slow & ~speed_changes(test, path, _NEAR)
    before, inward = level_before(experiment, trial), _lowest_inward(experiment, trial, steady)
    lifts = []
    for move, rest in moves_of(trial):
        if move.kind != "unload" or move.control != Control.DISPLACEMENT:
            continue
        # a specimen that is still pressed at the end has its own zero in the file's
        end = flat = None
        if rest is not None:
            end = level_of(experiment, trial, _of_rest(trial, rest, _LATE, 1.0))
            flat = _flat(experiment, trial, move, rest)
        rest_level = before or Level(0.0, experiment.floor.ou)
        rubbed = Level(rest_level.value - rubs.value, float(np.hypot(rest_level.sd, rubs.sd)))
        every = (before, inward, end, flat, Level(0.0, experiment.floor.ou), rubbed)
        levels = [one for one in every if one is not None]
        rows = rows_between(trial, move.start, move.stop)
        rows = rows[steady[rows]]
        if (rest is not None and end is None) or rows.size < _WIDTH:
            continue
        zero = min(levels, key=lambda one: one.value)
        speed = mean_speed(trial, move)
        moving = _pull(experiment, trial, move, _lowest(trial, rows), zero, speed)
        resting, lasts = None, False
        if rest is not None:
            early = _of_rest(trial, rest, _AFTER, 2.0 * _AFTER)
            resting = _pull(experiment, trial, rest, early, zero, speed)
            lasts = early.size >= _LASTS
        if moving is not None:
            fall = _first_fall(experiment, trial, move, speed)
            at_once = fall is None or fall.value + 2.0 * fall.sd > _HALF * moving.value
            lifts.append(Lift(moving, resting, lasts, at_once))
    return lifts


def _of_rest(trial: Trial, rest: Phase, begin: float, end: float) -> Rows:
    """Return the readings of a share of a rest, three at least where it has as many there."""
    lasts = rest.stop - rest.start
    rows = rows_between(trial, rest.start + begin * lasts, rest.start + end * lasts)
    if rows.size >= FEWEST:
        return rows
    every = rows_between(trial, rest.start, rest.stop)
    first = min(int(begin * every.size), max(every.size - FEWEST, 0))
    return every[first : first + FEWEST]


def _lowest(trial: Trial, rows: Rows) -> Rows:
    """Return the readings in a row whose mean force is the lowest."""
    means = np.convolve(trial.test.force[rows], np.full(_WIDTH, 1.0 / _WIDTH), mode="valid")
    lowest = int(np.argmin(means))
    return rows[lowest : lowest + _WIDTH]


def _lowest_inward(experiment: Experiment, trial: Trial, steady: Mask) -> Level | None:
    """Return the lowest force of the first ramp; None where it has too few readings."""
    first = next((phase for phase in trial.phases if phase.kind == "ramp"), None)
    if first is None:
        return None
    rows = rows_between(trial, first.start, first.stop)
    rows = rows[steady[rows]]
    return level_of(experiment, trial, _lowest(trial, rows)) if rows.size >= _WIDTH else None


def _first_fall(experiment: Experiment, trial: Trial, move: Phase, speed: float) -> Place | None:
    """Return by how much the force falls until the movement has reached its speed."""
    rows = rows_between(trial, move.start, move.stop)
    fast = np.abs(trial.trajectory.velocity(trial.test.time[rows])) >= _REACHED * speed
    rest = np.arange(max(int(rows[0]) - _WIDTH, 0), int(rows[0]))
    before = level_of(experiment, trial, rest)
    if before is None or not np.any(fast):
        return None
    after = float(trial.test.force[rows[int(np.argmax(fast))]])
    sd = float(np.hypot(before.sd, experiment.floor.total))
    return Place(trial, move.kind, before.value - after, sd, speed)


def _pull(
    experiment: Experiment, trial: Trial, phase: Phase, rows: Rows, zero: Level, speed: float
) -> Place | None:
    level = level_of(experiment, trial, rows)
    if level is None:
        return None
    sd = float(np.hypot(level.sd, zero.sd))
    return Place(trial, phase.kind, zero.value - level.value, sd, speed)


def friction_seen(experiment: Experiment) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force that turns with the direction, at any speed.

    Where a platen has moved back, the force is flat at the end of the movement, the same after the
    stop, and lower than before the contact; or it is flat and higher as the platen begins to move
    in, at speeds that differ by a factor of two. A drag ends with the motion; a specimen that pulls
    lets go, or relaxes. It is beyond doubt where most tests show it, and it is more than a tare
    that wanders.
    """
    every = [place for trial in experiment.trials for place in _rubs(experiment, trial)]
    if not any(place.is_clear for place in every):
        every = _every_inward(experiment)
        speeds = [place.speed for place in every if place.is_clear]
        every = every if speeds and max(speeds) >= 2.0 * min(speeds) else []
        way, side = "above", "as the platen moves in"
    else:
        way, side = "below", "as the platen moves back and at rest"
    places = [place for place in every if place.is_clear]
    if len(places) < 2:
        return ()
    values = [one.value for one in places]
    agree = max(values) < _AGREE * min(values)
    value, sd = pooled(places)
    tests, phases = names_of(places)
    unit = experiment.units.force
    return (
        DirectEvidence(
            "friction", "force off the specimen that turns with the direction", value, sd, unit,
            tests, phases,
            f"off the specimen the force stays {plain(value)} +- {plain(sd, 2)} {unit} {way} that "
            f"before the motion, {side}: something rubs",
            agree
            and value > max(CLEAR * sd, WANDERS * experiment.peak)
            and 2 * len(tests) > len({one.trial.name for one in every}),
        ),
    )  # fmt: skip


def _rubs(experiment: Experiment, trial: Trial) -> list[Place]:
    before = level_before(experiment, trial)
    if before is None:
        return []
    places = []
    for move, rest in moves_of(trial):
        if move.kind != "unload" or move.control != Control.DISPLACEMENT or rest is None:
            continue
        level = _flat(experiment, trial, move, rest)
        if level is not None:
            sd = float(np.hypot(before.sd, level.sd))
            place = Place(trial, move.kind, before.value - level.value, sd, mean_speed(trial, move))
            places.append(place)
    return places


def _every_inward(experiment: Experiment) -> list[Place]:
    """Return by how much the force is higher as the platen begins to move in, where it is flat."""
    places = []
    for trial in experiment.trials:
        before = level_before(experiment, trial)
        first = next((phase for phase in trial.phases if phase.kind == "ramp"), None)
        if before is None or first is None or first.control != Control.DISPLACEMENT:
            continue
        lasts = first.stop - first.start
        rows = rows_between(trial, first.start + _BEGUN * lasts, first.start + _END * lasts)
        parts = np.array_split(rows[~speed_changes(trial.test, trial.trajectory, _NEAR)[rows]], 3)
        levels = [level_of(experiment, trial, part) for part in parts]
        values = [one.value - before.value for one in levels if one is not None]
        if len(values) < len(parts):
            continue
        sd = float(np.hypot(before.sd, max(one.sd for one in levels if one is not None)))
        mean = float(np.mean(values))
        if np.ptp(values) <= max(_SETTLED * abs(mean), 2.0 * sd):
            places.append(Place(trial, first.kind, mean, sd, mean_speed(trial, first)))
    return places


def _flat(experiment: Experiment, trial: Trial, move: Phase, rest: Phase) -> Level | None:
    """Return the force at the end of a movement and in the rest after it, if it is one force.

    A specimen that pulls changes its force with the depth, and one that has let go has none. At the
    end of a long rest a specimen may come back to the platen.
    """
    steady = ~speed_changes(trial.test, trial.trajectory, _NEAR)
    moving = rows_between(trial, move.stop - _END * (move.stop - move.start), move.stop)
    early = _AFTER * (rest.stop - rest.start)
    resting = rows_between(trial, rest.start + early, rest.start + 2.0 * early)
    parts = (*np.array_split(moving[steady[moving]], 2), resting)
    every = [level_of(experiment, trial, rows) for rows in parts]
    levels = [one for one in every if one is not None]
    if len(levels) < len(every):
        return None
    values = [one.value for one in levels]
    off = _SETTLED * abs(values[-1]) + 3.0 * max(one.sd for one in levels)
    return levels[-1] if np.ptp(values) <= off else None
