"""Direct evidence from loadings: first contacts off the file's zero, and later loadings lower."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from qlvbayes.io.contact import FirstContact, find_contact
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    AT_ZERO,
    CLEAR,
    DirectEvidence,
    Level,
    Place,
    mean_speed,
    moves_of,
    pooled,
    rows_between,
    told,
)
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import Phase

_AGREE = 3.0  # errors, within which tests have one contact
_SAME_SPEED = 0.05  # of the speed, within which two ramps are equal
_SAME_START = 0.01  # of the depth, within which two ramps begin alike
_DEPTHS = 5  # depths at which two ramps are set side by side
_FEWEST = 12  # readings of a ramp
_REMEMBERED = float(np.exp(-1.0))
"""Most that a press of a time T leaves of the force after a rest R, over T/R.

A mode of relaxation time s relaxes by T/s at most in the press, and of that e^{-R/s} is left;
T/s e^{-R/s} is largest at s = R.
"""


def contact_of(experiment: Experiment, trial: Trial) -> FirstContact | None:
    """Return where the force of a test begins to rise; None if no approach shows it."""
    first = next((phase for phase in trial.phases if phase.kind == "ramp"), trial.phases[0])
    if experiment.units.dimensionless or first.control == Control.FORCE:
        return None
    way = trial.test.displacement
    at_zero = abs(float(way[0])) <= AT_ZERO * experiment.depth
    contact = find_contact(way, trial.test.force, at_zero=at_zero)
    if contact is None or not np.all(np.isfinite([contact.position, contact.sd, contact.force_sd])):
        return None
    return contact


def contact_seen(experiment: Experiment) -> Iterator[DirectEvidence]:
    """Yield the evidence of a force that begins before or after the file's zero.

    A soft beginning looks like a late contact, which is therefore not beyond doubt.
    """
    places = []
    for trial in experiment.trials:
        contact = contact_of(experiment, trial)
        begun = float(trial.test.displacement[0]) > AT_ZERO * experiment.depth
        if contact is not None and not begun and contact.sd > 0.0:
            places.append(Place(trial, "ramp", float(contact.position), float(contact.sd)))
    if len(places) < 2 or abs((found := pooled(places)).value) < CLEAR * found.sd:
        return
    off = [abs(one.value - found.value) / np.hypot(one.sd, found.sd) for one in places]
    unit, early = experiment.units.displacement, found.value < 0.0
    side = "before the file's zero" if early else "after the file's zero, where a soft beginning"
    yield told(
        "contact_offset", "depth at which the force begins", found, unit, places,
        f"the force begins at {plain(found.value)} +- {plain(found.sd, 2)} {unit}, {side}"
        + ("" if early else " looks alike"), early and max(off) < _AGREE,
    )  # fmt: skip


def repeated_seen(experiment: Experiment) -> Iterator[DirectEvidence]:
    """Yield the evidence of a later ramp below an earlier one, at equal depth and speed.

    What a relaxation of any time may have left of the earlier press after the rest between both is
    taken off. Softening, a set, conditioning and a leak all lower the force: one of them is there,
    and none by itself is beyond doubt.
    """
    if any(not trial.test.start_known for trial in experiment.trials[1:]):
        ramps = [_ramps(trial) for trial in experiment.trials]
    else:
        ramps = [[one for trial in experiment.trials for one in _ramps(trial)]]
    places = []
    for some in ramps:
        some.sort(key=lambda one: one[0].whole.start_s + one[1].start)
        for earlier, later in pairwise(some):
            place = _fall(experiment, earlier, later)
            if place is not None and place.value > 0.0:
                places.append(place)
    clear = [one for one in places if one.is_clear]
    if not clear:
        return
    most, unit = max(clear, key=lambda one: one.value / one.sd), experiment.units.force
    yield told(
        "stress_softening", "fall of the force from a loading to the next",
        Level(most.value, most.sd), unit, clear,
        f"at equal depth, speed and rest a later loading is lower by {plain(most.value)} +- "
        f"{plain(most.sd, 2)} {unit} than an earlier one: it softens, sets or leaks",
        False,  # which of them it is, these loadings do not show
    )  # fmt: skip


def _ramps(trial: Trial) -> list[tuple[Trial, Phase]]:
    return [
        (trial, move)
        for move, _ in moves_of(trial)
        if move.kind == "ramp"
        and move.control == Control.DISPLACEMENT
        and rows_between(trial, move.start, move.stop).size >= _FEWEST
    ]


def _fall(
    experiment: Experiment, earlier: tuple[Trial, Phase], later: tuple[Trial, Phase]
) -> Place | None:
    """Return by how much the later of two ramps is lower, beyond what relaxation may leave."""
    (one, first), (two, second) = earlier, later
    speeds = mean_speed(one, first), mean_speed(two, second)
    if abs(speeds[1] / speeds[0] - 1.0) > _SAME_SPEED:
        return None
    starts, stops = np.transpose(
        [trial.trajectory.displacement([p.start, p.stop]) for trial, p in (earlier, later)]
    )
    if abs(starts[1] - starts[0]) > _SAME_START * experiment.depth:
        return None
    backs = [p for p in one.used_phases if p.kind == "unload" and p.start >= first.stop]
    if not backs:
        return None
    back, since = backs[0], two.whole.start_s - one.whole.start_s
    rest = since + second.start - back.stop
    if rest <= 0.0:
        return None
    pressed = back.stop - first.start
    bottom, top = float(np.max(starts)), float(np.min(stops))
    if top <= bottom:
        return None
    depths = np.linspace(bottom, top, _DEPTHS + 2)[2:-1]
    of = [_force_at(trial, move, depths) for trial, move in (earlier, later)]
    memory = min(_REMEMBERED * pressed / rest, 1.0)
    lower = float(np.mean(of[0] - of[1] - memory * np.abs(of[0])))
    sd = float(np.sqrt(2.0) * experiment.floor.total)
    return Place(two, "ramp", lower, sd, speeds[1])


def _force_at(trial: Trial, move: Phase, depths: np.ndarray) -> np.ndarray:
    rows = rows_between(trial, move.start, move.stop)
    path = np.maximum.accumulate(trial.trajectory.displacement(trial.test.time[rows]))
    return np.interp(depths, path, trial.test.force[rows])
