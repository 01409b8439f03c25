"""Direct evidence from platens that move back: adhesion, or a bond, and friction of the guide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.io.arrays import Mask
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.record import (
    CLEAR,
    FEWEST,
    WANDERS,
    DirectEvidence,
    MeanForce,
    Place,
    Rows,
    exponent,
    first_ramp,
    level_before,
    level_of,
    mean_speed,
    moves_of,
    pooled,
    shown,
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
_SURFACE = 0.1  # of the greatest depth, from where a specimen has come back to its surface
_OFF = 2.0  # errors of the contact, within which the specimen may be touched


@dataclass(frozen=True)
class Lift:
    """A movement back: what it pulls by as it moves, and at rest after it."""

    moving: Place
    resting: Place | None
    lasts: bool  # whether the pull at rest is that of many readings
    comes_at_once: bool  # whether the force falls by half of the pull as the movement begins
    to_surface: bool  # whether the platen goes back to where it touched, or beyond


def adhesion_seen(experiment: Experiment, *, bonded: bool) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force of the other sign after contact; empty for bonded pads.

    It counts from the lowest of the file's zero and what the test shows before the contact, on the
    way in and at its end, so that a tare that is off, a drive that ripples or a guide that rubs is
    none; what any test shows to rub on the way in, rubs on the way back of all. A drag pulls too,
    by a power of the speed, and no longer when the platen rests; it is there at once as the platen
    moves back, as a film is, which is thinnest at the greatest depth. A guide that rubs pulls at
    any depth: unless the platen goes back to the surface, or a test shows that less rubs on the
    way in, the pull may be its. Else it is beyond doubt where it lasts at rest, does not grow with
    the speed, or comes gradually, in most tests that move back: what is sticky sticks in all.
    """
    if bonded or experiment.units.dimensionless:
        return ()
    approaching = _every_inward(experiment)
    inward = [one for one in approaching if one.is_clear]
    rubs = MeanForce(*pooled(inward)) if inward else MeanForce(0.0, 0.0)
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
    returned = any(one.to_surface for one in lifts)
    guided = not (approaching or returned or high > _most_that_rubs(experiment))
    if guided:
        why = "which a guide that rubs may also do, as the platen does not go back to the surface"
    tests = {one.trial.name for one in places}
    sizes = plain(high) if low == high else f"{plain(low)} to {plain(high)}"
    return shown(
        "adhesion", "pull after contact", places, (high, largest.sd), unit,
        f"after contact the specimen pulls by {sizes} {unit} (error {plain(largest.sd, 2)}) in "
        f"{len(tests)} of {len(experiment.trials)} tests, {why}",
        sure=(at_rest or speedless or gradual) and not guided and 2 * len(tests) > len(back),
    )  # fmt: skip


def _lifts(experiment: Experiment, trial: Trial, rubs: MeanForce) -> list[Lift]:
    path, test = trial.trajectory, trial.test
    slow = np.abs(path.acceleration(test.time)) <= _SLOW * path.top_acceleration
    steady = slow & ~speed_changes(test, path, _NEAR)
    first = trial.first_ramp
    before = level_before(experiment, trial)
    inward = None if first is None else _lowest(experiment, trial, first, steady)
    lifts = []
    for _, move, rest in moves_of([trial], "unload"):
        # a specimen that is still pressed at the end has its own zero in the file's
        end = flat = level = None
        lasts = False
        if rest is not None:
            end = level_of(experiment, trial, _of_rest(trial, rest, _LATE, 1.0))
            flat = _flat(experiment, trial, move, rest)
            early = _of_rest(trial, rest, _AFTER, 2.0 * _AFTER)
            level, lasts = level_of(experiment, trial, early), early.size >= _LASTS
        rest_level = before or MeanForce(0.0, experiment.floor.ou)
        rubbed = MeanForce(rest_level.value - rubs.value, float(np.hypot(rest_level.sd, rubs.sd)))
        every = (before, inward, end, flat, MeanForce(0.0, experiment.floor.ou), rubbed)
        zero = min((one for one in every if one is not None), key=lambda one: one.value)
        lowest = _lowest(experiment, trial, move, steady)
        if (rest is not None and end is None) or lowest is None:
            continue
        speed = mean_speed(trial, move)
        moving, resting = Place.between(trial, move, zero, lowest, speed), None
        if rest is not None and level is not None:
            resting = Place.between(trial, rest, zero, level, speed)
        fall = _first_fall(experiment, trial, move, speed)
        at_once = fall is None or fall.value + 2.0 * fall.sd > _HALF * moving.value
        reached = _SURFACE * experiment.depth + _OFF * (test.contact_sd or 0.0)
        to_surface = bool(path.displacement(move.stop) <= reached)
        lifts.append(Lift(moving, resting, lasts, at_once, to_surface))
    return lifts


def _of_rest(trial: Trial, rest: Phase, begin: float, end: float) -> Rows:
    """Return the readings of a share of a rest, three at least where it has as many there."""
    lasts = rest.stop - rest.start
    rows = trial.rows(rest.start + begin * lasts, rest.start + end * lasts)
    if rows.size >= FEWEST:
        return rows
    every = trial.rows(rest.start, rest.stop)
    first = min(int(begin * every.size), max(every.size - FEWEST, 0))
    return every[first : first + FEWEST]


def _lowest(experiment: Experiment, trial: Trial, move: Phase, steady: Mask) -> MeanForce | None:
    """Return the lowest mean force of a few readings in a row; None where there are too few."""
    rows = trial.rows(move.start, move.stop)
    rows = rows[steady[rows]]
    if rows.size < _WIDTH:
        return None
    means = np.convolve(trial.test.force[rows], np.full(_WIDTH, 1.0 / _WIDTH), mode="valid")
    return level_of(experiment, trial, rows[int(np.argmin(means)) :][:_WIDTH])


def _first_fall(experiment: Experiment, trial: Trial, move: Phase, speed: float) -> Place | None:
    """Return by how much the force falls until the movement has reached its speed."""
    rows = trial.rows(move.start, move.stop)
    fast = np.abs(trial.trajectory.velocity(trial.test.time[rows])) >= _REACHED * speed
    rest = np.arange(max(int(rows[0]) - _WIDTH, 0), int(rows[0]))
    before = level_of(experiment, trial, rest)
    if before is None or not np.any(fast):
        return None
    after = float(trial.test.force[rows[int(np.argmax(fast))]])
    return Place.between(trial, move, before, MeanForce(after, experiment.floor.total), speed)


def friction_seen(experiment: Experiment) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force that turns with the direction, at any speed.

    Where a platen has moved back, the force is flat at the end of the movement, the same after the
    stop, and lower than before the contact; or it is flat and higher as the platen begins to move
    in, at speeds that differ by a factor of two. A drag ends with the motion; a specimen that pulls
    lets go, or relaxes. It is beyond doubt where most tests show it, it is more than a tare that
    wanders, and no less rubs on the way in: what holds on to the platen far off its surface pulls
    alike, and does nothing before the contact.
    """
    every = [place for trial in experiment.trials for place in _rubs(experiment, trial)]
    inward = _every_inward(experiment)
    if not any(place.is_clear for place in every):
        every, inward = inward, []
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
    size = value, sd = pooled(places)
    most = 2 * len({one.trial.name for one in places}) > len({one.trial.name for one in every})
    before = pooled(inward) if inward else size
    one_way = before[0] + 2.0 * before[1] < _HALF * value
    unit = experiment.units.force
    return shown(
        "friction", "force off the specimen that turns with the direction", places, size, unit,
        f"off the specimen the force stays {plain(value)} +- {plain(sd, 2)} {unit} {way} that "
        f"before the motion, {side}: "
        + ("it sticks, as less rubs on the way in" if one_way else "something rubs"),
        sure=agree and most and not one_way and value > max(CLEAR * sd, WANDERS * experiment.peak),
    )  # fmt: skip


def _rubs(experiment: Experiment, trial: Trial) -> list[Place]:
    before = level_before(experiment, trial)
    if before is None:
        return []
    moves = [(move, rest) for _, move, rest in moves_of([trial], "unload") if rest is not None]
    levels = [(move, _flat(experiment, trial, move, rest)) for move, rest in moves]
    return [
        Place.between(trial, move, before, level, mean_speed(trial, move))
        for move, level in levels
        if level is not None
    ]


def _every_inward(experiment: Experiment) -> list[Place]:
    """Return by how much the force is higher as the platen begins to move in, where it is flat.

    Where a test approaches from off the specimen, that is its way to the contact.
    """
    places = []
    for trial in experiment.trials:
        before, first = level_before(experiment, trial), first_ramp(trial)
        if before is None or first is None:
            continue
        lasts = first.stop - first.start
        rows = trial.rows(first.start + _BEGUN * lasts, first.stop)
        clear = -_OFF * (trial.test.contact_sd or 0.0)
        rows = rows[: int(np.argmax(trial.test.displacement[rows] >= clear))]
        if rows.size < 3 * FEWEST:
            rows = trial.rows(first.start + _BEGUN * lasts, first.start + _END * lasts)
        parts = np.array_split(rows[~speed_changes(trial.test, trial.trajectory, _NEAR)[rows]], 3)
        levels = _levels(experiment, trial, parts)
        if levels is None:
            continue
        values = [one.value for one in levels]
        level = MeanForce(float(np.mean(values)), max(one.sd for one in levels))
        place = Place.between(trial, first, level, before, mean_speed(trial, first))
        if np.ptp(values) <= max(_SETTLED * abs(place.value), 2.0 * place.sd):
            places.append(place)
    return places


def _most_that_rubs(experiment: Experiment) -> float:
    """Return the least force soon after a test has touched, to which what rubs has added."""
    least = [np.inf]
    for trial in experiment.trials:
        if (first := first_ramp(trial)) is None:
            continue
        rows = trial.rows(first.start, first.stop)
        share = (trial.test.displacement[rows] - (trial.test.contact_sd or 0.0)) / experiment.depth
        rows = rows[(share >= _BEGUN) & (share <= _SURFACE)]
        if (level := level_of(experiment, trial, rows)) is not None:
            least.append(level.value + 2.0 * level.sd)
    return float(min(least))


def _levels(experiment: Experiment, trial: Trial, parts: Sequence[Rows]) -> list[MeanForce] | None:
    """Return the force of each of some parts; None where one has too few readings."""
    every = [level_of(experiment, trial, rows) for rows in parts]
    known = [one for one in every if one is not None]
    return known if len(known) == len(every) else None


def _flat(experiment: Experiment, trial: Trial, move: Phase, rest: Phase) -> MeanForce | None:
    """Return the force at the end of a movement and in the rest after it, if it is one force.

    A specimen that pulls changes its force with the depth, and one that has let go has none. At the
    end of a long rest a specimen may come back to the platen.
    """
    steady = ~speed_changes(trial.test, trial.trajectory, _NEAR)
    moving = trial.rows(move.stop - _END * (move.stop - move.start), move.stop)
    early = _AFTER * (rest.stop - rest.start)
    resting = trial.rows(rest.start + early, rest.start + 2.0 * early)
    levels = _levels(experiment, trial, (*np.array_split(moving[steady[moving]], 2), resting))
    if levels is None:
        return None
    values = [one.value for one in levels]
    off = _SETTLED * abs(values[-1]) + 3.0 * max(one.sd for one in levels)
    return levels[-1] if np.ptp(values) <= off else None
