"""Channels that repeat one value while the other one changes: stuck, or clipped at the range."""

from __future__ import annotations

import numpy as np

from qlvbayes.io.arrays import Array
from qlvbayes.motion.badreadings.channels import Channels
from qlvbayes.motion.badreadings.outliers import Run, equal_runs
from qlvbayes.motion.badreadings.result import Bad

_AROUND = 60  # readings on either side that say how often a value repeats by chance
_FEWEST = 4  # readings in a row that repeat a value
_CHANCE = 1e-9  # probability of such a run anywhere in the record
_REPEATING = 0.3  # of the readings around: a channel that repeats more often is coarse or silent
_ALTERNATING = 0.4  # of the changes of slope: noise changes sign, a curve does not
_NEAR_ZERO = 0.02  # of the range: a force that says there is no contact, as a test's first one may
_CATCHES_UP = 3.5  # times the median change: the jump of a channel that was stuck
_AS_FAR = (0.4, 2.5)  # of the way that the speed nearby makes meanwhile: that jump
_GOES_ON = 0.5  # of the change of force meanwhile: it does not jump along


def stuck_force(own: Channels) -> list[Bad]:
    """Return runs in which the force repeats a value although its noise should change it."""
    top, bottom = float(own.force.max()), float(own.force.min())
    return [
        Bad(first + 1, stop, "force", "stuck")
        for first, stop in _improbable(own)
        if own.force[first] not in (top, bottom)
    ]


def clipped_force(own: Channels) -> list[Bad]:
    """Return readings that stay at the largest or smallest force in spite of noise."""
    clipped: list[Bad] = []
    for end in {float(own.force.max()), float(own.force.min())}:
        if any(own.force[first] == end for first, _ in _improbable(own)):
            clipped += [
                Bad(first, stop, "force", "clipped")
                for first, stop in equal_runs(own.force, 1)
                if own.force[first] == end
            ]
    return clipped


def stuck_displacement(own: Channels) -> list[Bad]:
    """Return runs in which the displacement stays constant and then jumps to catch up."""
    changes = np.abs(np.diff(own.displacement))
    stuck = []
    for first, stop in equal_runs(own.displacement, 3):
        if stop == own.time.size or first < 2:
            continue
        jump = float(changes[stop - 1])
        if jump <= _CATCHES_UP * own.of_displacement.step:
            continue
        if jump <= _CATCHES_UP * _typical_change(changes, first, stop):
            continue
        if _caught_up(own, (first, stop)) and _went_on(own, (first, stop)):
            stuck.append(Bad(first + 1, stop, "displacement", "stuck"))
    return stuck


def _typical_change(changes: Array, first: int, stop: int) -> float:
    near = np.concatenate([changes[max(first - 10, 0) : first], changes[stop : stop + 10]])
    near = near[near > 0.0]
    return float(np.median(near)) if near.size else np.inf


def _caught_up(own: Channels, run: Run) -> bool:
    """Return whether the jump is as large as the motion at the speed before or after the run."""
    first, stop = run
    after = min(stop + 5, own.time.size - 1)
    before = max(first - 5, 0)
    jump = own.displacement[stop] - own.displacement[stop - 1]
    elapsed = own.time[stop] - own.time[first]
    ways = [
        elapsed * (own.displacement[b] - own.displacement[a]) / (own.time[b] - own.time[a])
        for a, b in ((before, first), (stop, after))
        if b > a
    ]
    return any(travel != 0.0 and _AS_FAR[0] < jump / travel < _AS_FAR[1] for travel in ways)


def _went_on(own: Channels, run: Run) -> bool:
    first, stop = run
    whole = abs(float(own.force[stop] - own.force[first]))
    last = abs(float(own.force[stop] - own.force[stop - 1]))
    noise = 8.0 * float(own.of_force.deviation[first]) + own.of_force.step
    return whole > noise and last < _GOES_ON * whole


def _improbable(own: Channels) -> list[Run]:
    """Return runs of one value, away from zero, that noise as around them would not produce."""
    force, scale = own.force, own.of_force
    away = np.minimum(np.abs(force), np.abs(force - force[0])) > _NEAR_ZERO * scale.span
    rarest = np.log(_CHANCE / force.size) / np.log(0.5 / _AROUND)
    return [
        run
        for run in equal_runs(force, max(_FEWEST, int(np.ceil(rarest))))
        if away[run[0]]
        and float(scale.deviation[run[0]]) >= scale.step
        and _against_noise(force, run)
    ]


def _against_noise(force: Array, run: Run) -> bool:
    first, stop = run
    before = force[max(first - _AROUND, 0) : first]
    after = force[stop : stop + _AROUND]
    changes = np.concatenate([np.diff(before), np.diff(after)])
    bends = [np.diff(part, n=2) for part in (before, after)]
    if changes.size < _AROUND // 2:
        return False
    repeating = float(np.mean(changes == 0.0))
    if repeating > _REPEATING:
        return False
    turns = np.concatenate([np.sign(b[1:]) * np.sign(b[:-1]) < 0.0 for b in bends])
    if np.mean(turns) < _ALTERNATING:
        return False
    chance = max(repeating, 1.0 / changes.size)
    return bool(force.size * chance ** (stop - first - 1) < _CHANCE)
