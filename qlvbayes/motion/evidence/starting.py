"""Direct evidence from starts and stops: inertia, a delay of the force, and ringing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    AGREE,
    CLEAR,
    DirectEvidence,
    Levels,
    Place,
    off_their_mean,
    pooled,
    shown,
)
from qlvbayes.motion.phases import Phase

_AROUND = 5  # readings before and after a start, whose means are levels
_REACHED = 0.9  # of the top speed, at which a start is over
_RETURNS = 0.25  # of a spike, that may be left after it
_SCATTER = 0.5  # of the impulses that a mass makes, by which single ones may differ
_COARSE = 0.5  # of an impulse, that its sum over one reading is off by
_READINGS = 200  # after a stop, in which a ringing is looked for,
_FEWEST = 40  # and at least so many
_TONES = 60  # frequencies that are tried
_HUMS = 2.0  # times the swing that is left as it fades, beyond which it is a hum
_FADING = (0.1, 0.25, 0.6)  # decays over a period, in frequencies: all of them ring
_SMALLEST = 1e-3  # of the peak, below which a swing may be a bend of the specimen's own
_SAME = 0.1  # of a frequency, within which stops ring alike
_ABOUT = 40  # readings before and after the stop of a ramp, in which a delay is looked for
_STEPS = 8  # of finding a delay, of which each leaves a small part
_TINY = 1e-300


def inertia_seen(tests: Sequence[Levels]) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a spike of force at starts and stops, which ends with them.

    Its impulse is mass times change of speed, however well the acceleration is resolved. A drag and
    a specimen do not let the force return; a specimen's own bend has the other sign.
    """
    places = [
        place
        for test in tests
        for move, _ in test.moves()
        for begins in (True, False)
        if (place := _impulse(test, move, begins=begins)) is not None
        if abs(place.value) > CLEAR * place.sd
    ]
    starts = sum(one.phase.startswith("start") for one in places)
    if len(places) < 2:
        return ()
    value, sd, scatter = _mass(places)
    if value < CLEAR * sd or scatter > _SCATTER:
        return ()  # a specimen's force, which bends
    units = tests[0].experiment.units
    unit = f"{units.force} s2/{units.displacement}"
    return shown(
        "inertia", "impulse at starts and stops over change of speed", places, (value, sd), unit,
        f"the force has a spike at {starts} starts and {len(places) - starts} stops, "
        f"of the sign of the acceleration, and returns: a moving mass of {plain(value)} +- "
        f"{plain(sd, 2)} {unit}",
        sure=0 < starts < len(places),
    )  # fmt: skip


def _mass(places: Sequence[Place]) -> tuple[float, float, float]:
    """Return the mass of all impulses, its sd, and their scatter over what the mass makes.

    Whatever else happens at starts and stops adds an impulse that does not grow with the change of
    speed, so that slow ones tell little of a mass.
    """
    masses, sds, speeds = np.array([(one.value, one.sd, one.speed) for one in places]).T
    mass = float(masses @ speeds**2 / (speeds @ speeds))
    left = float(np.mean((speeds * (masses - mass)) ** 2))
    weights = speeds**2 / ((speeds * sds) ** 2 + left)
    mass = float(masses @ weights / weights.sum())
    made = abs(mass) * float(np.sqrt(np.mean(speeds**2)))
    return mass, float(weights.sum()) ** -0.5, float(np.sqrt(left)) / max(made, _TINY)


def _impulse(test: Levels, move: Phase, *, begins: bool) -> Place | None:
    """Return the mass by the impulse of a start or a stop; None where the force does not return."""
    time, path = test.trial.test.time, test.trial.trajectory
    middle = 0.5 * (move.start + move.stop)
    instants = np.linspace(*((move.start, middle) if begins else (middle, move.stop)), 400)
    speeds = np.abs(path.velocity(instants))
    speed = float(speeds.max())
    fast = instants[speeds >= _REACHED * speed]
    # what creeps after it has braked does not move a mass
    ends = [move.start, fast[0]] if begins else [fast[-1], move.stop]
    first, stop = np.searchsorted(time, ends) + np.array([-2, 3])
    if first < _AROUND or stop > time.size - _AROUND:
        return None
    before = test.level(np.arange(first - _AROUND, first))
    after = test.level(np.arange(stop, stop + _AROUND))
    assert before is not None
    assert after is not None
    rows = np.arange(first, stop)
    lasts = float(time[stop - 1] - time[first])
    share = (time[rows] - time[first]) / max(lasts, _TINY)
    spike = test.trial.test.force[rows] - before.value - share * (after.value - before.value)
    highest = float(np.max(np.abs(spike)))
    change = float(np.diff(path.velocity(time[[first, stop - 1]]))[0])
    if abs(after.value - before.value) > _RETURNS * highest or abs(change) < 0.5 * speed:
        return None
    noise = test.experiment.floor.white * lasts / np.sqrt(rows.size)
    slow = lasts * 0.5 * (before.sd + after.sd)
    mass = float(np.trapezoid(spike, time[rows])) / change
    counted = max(int(np.count_nonzero(np.abs(spike) > 0.5 * highest)), 1)
    coarse = _COARSE * mass / counted / CLEAR
    sd = float(np.hypot(np.hypot(noise, slow) / change, coarse))
    where = f"{'start' if begins else 'stop'} of {move.kind}"
    return Place(mass, sd, test.trial, where, abs(change))


def lag_seen(tests: Sequence[Levels]) -> tuple[DirectEvidence, ...]:
    r"""Return the evidence of a force that stops rising later than the platen stops.

    About a stop at the time s, with depth d and speed v of the platen,

    .. math:: F(t) = a_0 + a_1 d + a_2 d^2 + e\,v + a_3 (t - s) + a_4 (t - s)^2

    where a delay is :math:`-e / a_1`, at any speed; depth and speed are then those earlier by it,
    and so on until nothing more is found. A drag, a film, and a relaxation that is faster than the
    readings have the other sign.
    """
    places = [
        place
        for test in tests
        for move, rest in test.moves("ramp")
        if rest is not None and rest.control == Control.DISPLACEMENT
        if (place := _delay(test, move, rest)) is not None
    ]
    if len(places) < 2:
        return ()
    size = value, sd = pooled(places)
    if value < CLEAR * sd:
        return ()
    speeds = [one.speed for one in places if one.is_clear]
    several = len(speeds) > 1 and max(speeds) >= 2.0 * min(speeds)
    return shown(
        "channel_lag", "delay of the force after a stop", places, size, "s",
        f"at {len(places)} stops the force follows the displacement {plain(value)} +- "
        f"{plain(sd, 2)} s later: one channel lags",
        sure=several and off_their_mean(places, size) < AGREE,
    )  # fmt: skip


def _delay(test: Levels, move: Phase, rest: Phase) -> Place | None:
    """Return the delay (s) about the stop of a movement; None where it cannot be measured."""
    read, path = test.trial.test, test.trial.trajectory
    before = test.trial.rows(move.start, move.stop)[-_ABOUT:]
    rows = np.concatenate([before, test.trial.rows(move.stop, rest.stop)[:_ABOUT]])
    if rows.size < 2 * _ABOUT:
        return None
    time, delay, sd = read.time[rows], 0.0, 0.0
    for _ in range(_STEPS):
        moved = np.clip(time - delay, read.time[0], read.time[-1])
        depth, speed = path.displacement(moved), path.velocity(moved)
        depth, since = depth - depth[-1], time - move.stop
        columns = np.stack([np.ones(rows.size), depth, depth**2, speed, since, since**2], axis=1)
        scales = np.abs(columns).max(axis=0)
        left, size, sds = _left(columns / scales, read.force[rows])
        noise = max(1.0, test.experiment.floor.total / max(np.sqrt(left / rows.size), _TINY))
        slope, drag = size[[1, 3]] / scales[[1, 3]]
        sd_slope, sd_drag = noise * sds[[1, 3]] / scales[[1, 3]]
        if not slope > CLEAR * sd_slope:
            return None
        more = -float(drag / slope)
        delay, sd = delay + more, float(np.hypot(sd_drag, more * sd_slope) / slope)
        if abs(delay) > 0.5 * (time[-1] - time[0]):
            return None
        if abs(more) < 0.1 * sd:
            break
    return Place(delay, sd, test.trial, f"stop of {move.kind}", test.speed(move))


def ringing_seen(tests: Sequence[Levels]) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a decaying sine after stops, of one frequency in all of them.

    The frequency is that after the fastest stop, and stops as fast as those that ring, ring, too: a
    specimen that recovers may look like a swing.
    """
    stops = [
        (test.speed(move), _tone(test, rest))
        for test in tests
        for move, rest in test.moves()
        if rest is not None and rest.control == Control.DISPLACEMENT
        if test.trial.rows(rest.start, rest.stop).size > _FEWEST
    ]
    fastest = max(stops, key=lambda one: one[0], default=(0.0, None))[1]
    experiment = tests[0].experiment
    if fastest is None or fastest.value < _SMALLEST * experiment.peak:
        return ()
    ringing = [
        (speed, place)
        for speed, place in stops
        if place is not None and abs(place.speed - fastest.speed) < _SAME * fastest.speed
    ]
    alike = [place for _, place in ringing]
    if len(alike) < 2:
        return ()
    slowest = min(speed for speed, _ in ringing)
    largest = max(alike, key=lambda one: one.value)
    unit = experiment.units.force
    return shown(
        "frame_ringing", "decaying sine after stops", alike, (largest.value, largest.sd), unit,
        f"after {len(alike)} stops the force swings at {plain(fastest.speed)} Hz and dies away"
        f", by up to {plain(largest.value)} +- {plain(largest.sd, 2)} {unit}: the frame rings",
        sure=len(alike) > 0.5 * sum(speed >= slowest for speed, _ in stops),
    )  # fmt: skip


def _tone(test: Levels, rest: Phase) -> Place | None:
    """Return the amplitude of a decaying sine after a stop; ``speed`` is its frequency (Hz)."""
    resting = test.trial.rows(rest.start, rest.stop)[1:]
    rows, later = np.split(resting[: 2 * _READINGS], [min(_READINGS, resting.size)])
    every, force = test.trial.test.time[resting], test.trial.test.force
    since = every - every[0]
    time, step = since[: rows.size], float(np.median(np.diff(since[: rows.size])))
    smooth = np.vander(np.log1p(time / step), 5, increasing=True)
    frequencies = np.geomspace(4.0 / time[-1], 0.3 / step, _TONES)
    tones, fading = np.repeat(frequencies, len(_FADING)), np.tile(_FADING, _TONES)
    turned = 2.0 * np.pi * tones * time[:, None]
    fall = np.exp(-fading * tones * time[:, None])
    swings = np.stack([fall, fall * np.cos(turned), fall * np.sin(turned)], axis=-1)
    columns = np.concatenate(
        [np.broadcast_to(smooth, (tones.size, *smooth.shape)), swings.transpose(1, 0, 2)], axis=-1
    )
    explained = np.einsum("tnk,n->tk", np.linalg.qr(columns)[0], force[rows])
    best = int(np.argmax(np.sum(explained**2, axis=1)))
    left, sizes, errors = _left(columns[best], force[rows])
    amplitude, sd = float(np.hypot(*sizes[-2:])), float(np.max(errors[-2:]))
    if amplitude < 2.0 * CLEAR * sd or left > 0.5 * _left(smooth, force[rows])[0]:
        return None
    if later.size >= _FEWEST:  # a hum of the mains goes on
        since = since[rows.size :][: later.size]
        turned = 2.0 * np.pi * tones[best] * since
        waves = np.column_stack([np.ones(later.size), since, np.cos(turned), np.sin(turned)])
        hum = np.hypot(*_left(waves, force[later])[1][2:])
        faded = amplitude * np.exp(-fading[best] * tones[best] * np.mean(since))
        if hum > _HUMS * faded + CLEAR * sd:
            return None
    return Place(amplitude, sd, test.trial, rest.kind, float(tones[best]))


def _left(columns: Array, values: Array) -> tuple[float, Array, Array]:
    """Return the sum of squares that least squares leave, the coefficients and their sds."""
    q, r = np.linalg.qr(columns)
    size = np.linalg.lstsq(r, q.T @ values, rcond=None)[0]
    left = float(np.sum((values - columns @ size) ** 2))
    variance = left / max(values.size - columns.shape[1], 1)
    inverse = np.linalg.pinv(r)
    return left, size, np.sqrt(variance * np.sum(inverse**2, axis=1))
