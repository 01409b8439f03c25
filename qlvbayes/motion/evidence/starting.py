"""Direct evidence from starts and stops: inertia, and ringing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    AROUND,
    CLEAR,
    HALF,
    REACHED,
    DirectEvidence,
    Level,
    Place,
    level_of,
    mean_speed,
    moves_of,
    pooled,
    rows_between,
    told,
)
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import Phase

_RETURNS = 0.25  # of a spike, that may be left after it
_READINGS = 200  # after a stop, in which a ringing is looked for,
_FEWEST = 40  # and at least so many
_SAME = 0.1  # of a frequency, within which stops ring alike


def inertia_seen(experiment: Experiment) -> Iterator[DirectEvidence]:
    """Yield the evidence of a spike of force at starts and stops, which ends with them.

    Its impulse is mass times change of speed, however well the acceleration is resolved. A drag and
    a specimen do not let the force return; a specimen's own bend has the other sign.
    """
    places = [
        place
        for trial in experiment.trials
        for move, _ in moves_of(trial)
        if move.control == Control.DISPLACEMENT
        for at_start in (True, False)
        for place in [_impulse(experiment, trial, move, at_start)]
        if place is not None and abs(place.value) > CLEAR * place.sd
    ]
    if len(places) < 2 or any(one.value < 0.0 for one in places):
        return
    found, starts = pooled(places), sum(one.phase.startswith("start") for one in places)
    scatter = float(np.std([one.value for one in places]))
    if found.value < CLEAR * found.sd or scatter > HALF * found.value:
        return  # a specimen's force, which bends
    unit = f"{experiment.units.force} s2/{experiment.units.displacement}"
    yield told(
        "inertia", "impulse at starts and stops over change of speed", found, unit, places,
        f"the force has a spike at {starts} starts and {len(places) - starts} stops, "
        f"of the sign of the acceleration, and returns: a moving mass of {plain(found.value)} +- "
        f"{plain(found.sd, 2)} {unit}",
        0 < starts < len(places),
    )  # fmt: skip


def _impulse(experiment: Experiment, trial: Trial, move: Phase, at_start: bool) -> Place | None:
    """Return the mass by the impulse at a start or stop; None where the force does not return."""
    path, time, mean = trial.trajectory, trial.test.time, mean_speed(trial, move)
    middle = 0.5 * (move.start + move.stop)
    half = np.linspace(*((move.start, middle) if at_start else (middle, move.stop)), 400)
    fast = np.flatnonzero(np.abs(path.velocity(half)) >= REACHED * mean)
    if fast.size == 0:
        return None
    # what creeps after it has braked does not move a mass
    span = (move.start, half[fast[0]]) if at_start else (half[fast[-1]], move.stop)
    first, stop = (int(k) for k in np.searchsorted(time, span))
    first, stop = first - 2, stop + 3
    if first < AROUND or stop > time.size - AROUND:
        return None
    rows = np.arange(first, stop)
    before = level_of(experiment, trial, np.arange(first - AROUND, first))
    after = level_of(experiment, trial, np.arange(stop, stop + AROUND))
    lasts = float(time[stop - 1] - time[first])
    if before is None or after is None or lasts <= 0.0:
        return None
    share = (time[rows] - time[first]) / lasts
    spike = trial.test.force[rows] - before.value - share * (after.value - before.value)
    highest = float(np.max(np.abs(spike)))
    change = float(np.diff(path.velocity(time[[first, stop - 1]]))[0])
    if abs(after.value - before.value) > _RETURNS * highest or abs(change) < 0.5 * mean:
        return None
    mass = float(np.trapezoid(spike, time[rows])) / change
    noise = experiment.floor.white * lasts / np.sqrt(rows.size)
    slow = lasts * 0.5 * (before.sd + after.sd)
    counted = max(int(np.count_nonzero(np.abs(spike) > 0.5 * highest)), 1)
    sd = np.hypot(np.hypot(noise, slow) / change, HALF * mass / counted / CLEAR)
    return Place(trial, f"{'start' if at_start else 'stop'} of {move.kind}", mass, float(sd))


def ringing_seen(experiment: Experiment) -> Iterator[DirectEvidence]:
    """Yield the evidence of a decaying sine after stops, of one frequency in all of them."""
    found = [
        place
        for trial in experiment.trials
        for _, rest in moves_of(trial)
        if rest is not None
        for place in [_tone(trial, rest)]
        if place is not None
    ]
    middle = float(np.median([one.speed for one in found])) if found else 0.0
    alike = [one for one in found if abs(one.speed - middle) < _SAME * middle]
    if len(alike) < 2:
        return
    largest, unit = max(alike, key=lambda one: one.value), experiment.units.force
    yield told(
        "frame_ringing", "decaying sine after stops", Level(largest.value, largest.sd), unit, alike,
        f"after {len(alike)} stops the force swings at {plain(middle)} Hz and dies away, by up "
        f"to {plain(largest.value)} +- {plain(largest.sd, 2)} {unit}: the frame rings",
        len(alike) > len(found) / 2,
    )  # fmt: skip


def _tone(trial: Trial, rest: Phase) -> Place | None:
    """Return the amplitude of a decaying sine after a stop; ``speed`` is its frequency (Hz)."""
    rows = rows_between(trial, rest.start, rest.stop)[1 : _READINGS + 1]
    if rows.size < _FEWEST or rest.control == Control.FORCE:
        return None
    time = trial.test.time[rows] - trial.test.time[rows[0]]
    force, step = trial.test.force[rows], float(np.median(np.diff(time)))
    smooth = np.log1p(time / step)[:, None] ** np.arange(5.0)
    without, best = _left(smooth, force)[0], (np.inf, 0.0, 0.0, 0.0)
    for tone in np.geomspace(4.0 / time[-1], 0.3 / step, 60):
        phase = 2.0 * np.pi * tone * time[:, None]
        for fading in (0.1, 0.25, 0.6):  # decays over a period, in frequencies: all of them ring
            fall = np.exp(-fading * tone * time)[:, None]
            swings = fall * np.hstack([np.ones_like(phase), np.cos(phase), np.sin(phase)])
            left, size, sds = _left(np.hstack([smooth, swings]), force)
            if left < best[0]:
                best = (left, float(tone), float(np.hypot(*size[-2:])), float(sds[-2:].max()))
    left, tone, amplitude, sd = best
    if amplitude < 2.0 * CLEAR * sd or left > 0.5 * without:
        return None
    return Place(trial, rest.kind, amplitude, sd, tone)


def _left(columns: Array, values: Array) -> tuple[float, Array, Array]:
    """Return the sum of squares that least squares leave, the coefficients and their sds."""
    q, r = np.linalg.qr(columns)
    inverse = np.linalg.pinv(r)
    size = inverse @ (q.T @ values)
    left = float(np.sum((values - columns @ size) ** 2))
    variance = left / max(values.size - columns.shape[1], 1)
    return left, size, np.sqrt(variance * np.sum(inverse**2, axis=1))
