"""Direct evidence from platens that move back: adhesion, or a bond, and friction of the guide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    CLEAR,
    FEWEST,
    WANDERS,
    DirectEvidence,
    Levels,
    MeanForce,
    Place,
    Rows,
    pooled,
    shown,
)
from qlvbayes.motion.phases import Phase

_WIDTH = 5  # readings whose mean is a force
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


def adhesion_seen(tests: Sequence[Levels]) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force of the other sign after contact, of pads that are not bonded.

    It counts from the lowest of the file's zero and what the test shows before the contact, on the
    way in and at its end, so that a tare that is off, a drive that ripples or a guide that rubs is
    none; what any test shows to rub on the way in, rubs on the way back of all. A drag pulls too,
    by a power of the speed, and no longer when the platen rests; it is there at once as the platen
    moves back, as a film is, which is thinnest at the greatest depth. A guide that rubs pulls at
    any depth: unless the platen goes back to the surface, or a test shows that less rubs on the
    way in, the pull may be its. Else it is beyond doubt where it lasts at rest, does not grow with
    the speed, or comes gradually, in most tests that move back: what is sticky sticks in all.
    """
    experiment = tests[0].experiment
    approaching = list(_inward(tests))
    inward = [one for one in approaching if one.is_clear]
    rubs = MeanForce(*pooled(inward)) if inward else MeanForce(0.0, 0.0)
    lifts = [lift for test in tests for lift in _lifts(test, rubs)]

    def pulls(place: Place | None) -> bool:
        least = WANDERS * experiment.peak
        return place is not None and place.is_clear and place.value > least

    resting = [lift for lift in lifts if pulls(lift.resting)]
    pulling = [lift for lift in lifts if pulls(lift.moving)]
    moving = [lift.moving for lift in pulling]
    at_rest = len(resting) > 1 or any(lift.lasts for lift in resting)
    places = moving if moving and not at_rest else [one.resting for one in resting if one.resting]
    if not places:
        return ()
    power = _exponent(moving)
    speedless = power is not None and power[0] + 2.0 * power[1] < _FLAT and power[0] > -1.0
    gradual = sum(not lift.comes_at_once for lift in pulling) > 1
    returned = any(lift.to_surface for lift in lifts)
    largest = max(places, key=lambda one: one.value)
    low, high = min(one.value for one in places), largest.value
    guided = not (approaching or returned or high > _most_that_rubs(tests))
    if guided:
        why = "which a guide that rubs may also do, as the platen does not go back to the surface"
    elif at_rest:
        why = "and it goes on while the platen rests: it sticks, or it is bonded"
    elif speedless:
        why = "and it does not grow with the speed: it sticks, or it is bonded"
    elif gradual:
        why = "and it comes gradually as the platen moves back: it sticks, or it is bonded"
    else:
        why = "which a drag or a film may also do"
    seen, back = ({one.trial.name for one in x} for x in (places, [one.moving for one in lifts]))
    unit, sizes = experiment.units.force, f"{plain(low)} to {plain(high)}"
    return shown(
        "adhesion", "pull after contact", places, (high, largest.sd), unit,
        f"after contact the specimen pulls by {plain(high) if low == high else sizes} {unit} "
        f"(error {plain(largest.sd, 2)}) in {len(seen)} of {len(tests)} tests, {why}",
        sure=(at_rest or speedless or gradual) and not guided and 2 * len(seen) > len(back),
    )  # fmt: skip


def _lifts(test: Levels, rubs: MeanForce) -> Iterator[Lift]:
    trial, floor = test.trial, test.experiment.floor
    path, before = trial.trajectory, test.before or MeanForce(0.0, floor.ou)
    rubbed = MeanForce(before.value - rubs.value, float(np.hypot(before.sd, rubs.sd)))
    zeros = [before, MeanForce(0.0, floor.ou), rubbed]
    inward = None if trial.first_ramp is None else _lowest(test, trial.first_ramp)
    for move, rest in test.moves("unload"):
        end = flat = level = resting = None
        lasts = False
        if rest is not None:
            # a specimen that is still pressed at the end has its own zero in the file's
            end = test.level(_of_rest(test, rest, _LATE, 1.0))
            flat = _flat(test, move, rest)
            early = _of_rest(test, rest, _AFTER, 2.0 * _AFTER)
            level, lasts = test.level(early), early.size >= _LASTS
        found = [one for one in (inward, end, flat) if one is not None]
        zero = min([*zeros, *found], key=lambda one: one.value)
        lowest = _lowest(test, move)
        if (rest is not None and end is None) or lowest is None:
            continue
        speed = test.speed(move)
        moving = test.fall(move, zero, lowest, speed)
        if rest is not None and level is not None:
            resting = test.fall(rest, zero, level, speed)
        fall = _first_fall(test, move, speed)
        at_once = fall is None or fall.value + 2.0 * fall.sd > _HALF * moving.value
        reached = _SURFACE * test.experiment.depth + _OFF * (trial.test.contact_sd or 0.0)
        to_surface = bool(path.displacement(move.stop) <= reached)
        yield Lift(moving, resting, lasts, at_once, to_surface)


def _exponent(places: Sequence[Place]) -> tuple[float, float] | None:
    """Return by which power of the speed a quantity grows, and its error.

    None where the speeds do not differ by a factor of two.
    """
    speeds = np.log([one.speed for one in places])
    if len(places) < 2 or np.ptp(speeds) < np.log(2.0):
        return None
    sizes = np.log([one.value for one in places])
    errors = np.array([one.sd / one.value for one in places])
    off = speeds - np.average(speeds, weights=errors**-2)
    spread = float(np.sum((off / errors) ** 2))
    slope = float(np.sum(off * sizes / errors**2)) / spread
    return slope, 1.0 / float(np.sqrt(spread))


def _of_rest(test: Levels, rest: Phase, begin: float, end: float) -> Rows:
    """Return the readings of a share of a rest, three at least where it has as many there."""
    lasts = rest.stop - rest.start
    rows = test.trial.rows(rest.start + begin * lasts, rest.start + end * lasts)
    if rows.size >= FEWEST:
        return rows
    every = test.trial.rows(rest.start, rest.stop)
    first = min(int(begin * every.size), max(every.size - FEWEST, 0))
    return every[first : first + FEWEST]


def _lowest(test: Levels, move: Phase) -> MeanForce | None:
    """Return the lowest mean force of a few readings in a row; None where there are too few."""
    path, rows = test.trial.trajectory, test.trial.rows(move.start, move.stop)
    pulled = np.abs(path.acceleration(test.trial.test.time[rows]))
    rows = rows[test.steady[rows] & (pulled <= _SLOW * path.top_acceleration)]
    if rows.size < _WIDTH:
        return None
    means = np.convolve(test.trial.test.force[rows], np.full(_WIDTH, 1.0 / _WIDTH), mode="valid")
    return test.level(rows[int(np.argmin(means)) :][:_WIDTH])


def _first_fall(test: Levels, move: Phase, speed: float) -> Place | None:
    """Return by how much the force falls until the movement has reached its speed."""
    trial, rows = test.trial, test.trial.rows(move.start, move.stop)
    fast = np.abs(trial.trajectory.velocity(trial.test.time[rows])) >= _REACHED * speed
    before = test.level(np.arange(max(int(rows[0]) - _WIDTH, 0), int(rows[0])))
    if before is None or not np.any(fast):
        return None
    after = float(trial.test.force[rows[int(np.argmax(fast))]])
    return test.fall(move, before, MeanForce(after, test.experiment.floor.total), speed)


def friction_seen(tests: Sequence[Levels]) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force that turns with the direction, at any speed.

    Where a platen has moved back, the force is flat at the end of the movement, the same after the
    stop, and lower than before the contact; or it is flat and higher as the platen begins to move
    in, at speeds that differ by a factor of two. A drag ends with the motion; a specimen that pulls
    lets go, or relaxes. It is beyond doubt where most tests show it, it is more than a tare that
    wanders, and no less rubs on the way in: what holds on to the platen far off its surface pulls
    alike, and does nothing before the contact.
    """
    every, inward = list(_outward(tests)), list(_inward(tests))
    way, side = "below", "as the platen moves back and at rest"
    if not any(place.is_clear for place in every):
        every, inward = inward, []
        speeds = [place.speed for place in every if place.is_clear]
        every = every if speeds and max(speeds) >= 2.0 * min(speeds) else []
        way, side = "above", "as the platen moves in"
    places = [place for place in every if place.is_clear]
    if len(places) < 2:
        return ()
    values = [one.value for one in places]
    agree = max(values) < _AGREE * min(values)
    size = value, sd = pooled(places)
    most = 2 * len({one.trial.name for one in places}) > len({one.trial.name for one in every})
    before = pooled(inward) if inward else size
    one_way = before[0] + 2.0 * before[1] < _HALF * value
    experiment = tests[0].experiment
    unit = experiment.units.force
    return shown(
        "friction", "force off the specimen that turns with the direction", places, size, unit,
        f"off the specimen the force stays {plain(value)} +- {plain(sd, 2)} {unit} {way} that "
        f"before the motion, {side}: "
        + ("it sticks, as less rubs on the way in" if one_way else "something rubs"),
        sure=agree and most and not one_way and value > max(CLEAR * sd, WANDERS * experiment.peak),
    )  # fmt: skip


def _outward(tests: Sequence[Levels]) -> Iterator[Place]:
    """Yield by how much the force is lower after each movement back, where it is flat."""
    for test in tests:
        for move, rest in test.moves("unload") if test.before else ():
            level = None if rest is None else _flat(test, move, rest)
            if test.before is not None and level is not None:
                yield test.fall(move, test.before, level, test.speed(move))


def _inward(tests: Sequence[Levels]) -> Iterator[Place]:
    """Yield by how much the force is higher as each platen begins to move in, where it is flat.

    Where a test approaches from off the specimen, that is its way to the contact.
    """
    for test in tests:
        trial, before, first = test.trial, test.before, test.first_ramp
        if before is None or first is None:
            continue
        lasts = first.stop - first.start
        rows = trial.rows(first.start + _BEGUN * lasts, first.stop)
        clear = -_OFF * (trial.test.contact_sd or 0.0)
        rows = rows[: int(np.argmax(trial.test.displacement[rows] >= clear))]
        if rows.size < 3 * FEWEST:
            rows = trial.rows(first.start + _BEGUN * lasts, first.start + _END * lasts)
        levels = test.levels(np.array_split(rows[test.steady[rows]], 3))
        if levels is None:
            continue
        values = [one.value for one in levels]
        level = MeanForce(float(np.mean(values)), max(one.sd for one in levels))
        place = test.fall(first, level, before, test.speed(first))
        if np.ptp(values) <= max(_SETTLED * abs(place.value), 2.0 * place.sd):
            yield place


def _most_that_rubs(tests: Sequence[Levels]) -> float:
    """Return the least force soon after a test has touched, to which what rubs has added."""
    least = [np.inf]
    for test in tests:
        if (first := test.first_ramp) is None:
            continue
        rows, read = test.trial.rows(first.start, first.stop), test.trial.test
        share = (read.displacement[rows] - (read.contact_sd or 0.0)) / test.experiment.depth
        rows = rows[(share >= _BEGUN) & (share <= _SURFACE)]
        if (level := test.level(rows)) is not None:
            least.append(level.value + 2.0 * level.sd)
    return float(min(least))


def _flat(test: Levels, move: Phase, rest: Phase) -> MeanForce | None:
    """Return the force at the end of a movement and in the rest after it, if it is one force.

    A specimen that pulls changes its force with the depth, and one that has let go has none. At the
    end of a long rest a specimen may come back to the platen.
    """
    moving = test.trial.rows(move.stop - _END * (move.stop - move.start), move.stop)
    early = _AFTER * (rest.stop - rest.start)
    resting = test.trial.rows(rest.start + early, rest.start + 2.0 * early)
    levels = test.levels((*np.array_split(moving[test.steady[moving]], 2), resting))
    if levels is None:
        return None
    values = [one.value for one in levels]
    off = _SETTLED * abs(values[-1]) + 3.0 * max(one.sd for one in levels)
    return levels[-1] if np.ptp(values) <= off else None
