"""Direct evidence from tests set side by side: contact, softening, a leak, a drift of the force."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from qlvbayes.io.contact import FirstContact, first_rises, most_slide
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.record import (
    CLEAR,
    WANDERS,
    DirectEvidence,
    MeanForce,
    Place,
    level_before,
    mean_speed,
    moves_of,
    off_their_mean,
    pooled,
    shown,
)
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import Phase

_AT_ZERO = 0.01  # of the depth, within which the platen has not left the file's zero
_AGREE = 3.0  # errors, within which tests have one contact, or their forces lie on one line
_SAME_SPEED = 0.05  # of the speed, within which two ramps are equal
_SAME_START = 0.01  # of the depth, within which two ramps begin alike
_DEPTHS = 5  # depths at which two ramps are set side by side
_FEWEST = 12  # readings of a ramp
_TESTS = 3  # tests whose forces before contact show a drift; one more, and it is beyond doubt
Press = tuple[Trial, Phase]
"""Loading of a test."""
_REMEMBERED = float(np.exp(-1.0))
"""Most that a press of a time T leaves of the force after a rest R, over T/R.

A mode of relaxation time s relaxes by T/s at most in the press, and of that e^{-R/s} is left;
T/s e^{-R/s} is largest at s = R.
"""


def contacts_of(experiment: Experiment) -> list[FirstContact | None]:
    """Return where the force of each test begins to rise; None if no approach shows it."""
    found = [_contact_of(experiment, trial) for trial in experiment.trials]
    slides = most_slide([later for _, later in found])
    return [later if slides and later else first for first, later in found]


def _contact_of(
    experiment: Experiment, trial: Trial
) -> tuple[FirstContact | None, FirstContact | None]:
    """Return the first rise of a test's force, and the one after sliding if that may be it."""
    first = next((phase for phase in trial.phases if phase.kind == "ramp"), trial.phases[0])
    if experiment.units.dimensionless or first.control == Control.FORCE:
        return None, None
    way, force = trial.test.displacement, trial.test.force
    at_zero = abs(float(way[0])) <= _AT_ZERO * experiment.depth
    contact, later = first_rises(way, force, at_zero=at_zero)
    return contact if contact is not None and contact.is_finite else None, later


def contact_seen(
    experiment: Experiment, contacts: Sequence[FirstContact | None]
) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force that begins before or after the file's zero.

    A soft beginning looks like a late contact, which is therefore not beyond doubt.
    """
    places = []
    for trial, contact in zip(experiment.trials, contacts, strict=True):
        begun = float(trial.test.displacement[0]) > _AT_ZERO * experiment.depth
        if contact is not None and not begun and contact.sd > 0.0:
            places.append(Place(float(contact.position), float(contact.sd), trial, "ramp"))
    if len(places) < 2:
        return ()
    size = value, sd = pooled(places)
    if abs(value) < CLEAR * sd:
        return ()
    unit, early = experiment.units.displacement, value < 0.0
    where = "before the file's zero" if early else "after the file's zero, where a soft beginning"
    return shown(
        "contact_offset", "depth at which the force begins", places, size, unit,
        f"the force begins at {plain(value)} +- {plain(sd, 2)} {unit}, {where}"
        + ("" if early else " looks alike"),
        sure=early and off_their_mean(places, size) < _AGREE,
    )  # fmt: skip


def repeated_seen(experiment: Experiment) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a later ramp below an earlier one, at equal depth and speed.

    What a relaxation of any time may have left of the earlier press after the rest between both is
    taken off. Softening, a set, conditioning and a leak all lower the force: one of them is there,
    and none by itself is beyond doubt.
    """
    trials = experiment.trials
    known = all(trial.test.start_known for trial in trials[1:])
    pairs = [pairwise(_ramps(some)) for some in ([trials] if known else [[one] for one in trials])]
    falls = (_fall(experiment, *pair) for some in pairs for pair in some)
    places = [place for place in falls if place is not None]
    clear = [one for one in places if one.is_clear]
    if not clear:
        return ()
    largest = max(clear, key=lambda one: one.value / one.sd)
    unit = experiment.units.force
    return shown(
        "stress_softening", "fall of the force from a loading to the next", clear,
        (largest.value, largest.sd), unit,
        f"at equal depth, speed and rest a later loading is lower by {plain(largest.value)} +- "
        f"{plain(largest.sd, 2)} {unit} than an earlier one: it softens, sets or leaks",
        sure=False,  # which of them it is, these loadings do not show
    )  # fmt: skip


def drift_seen(experiment: Experiment) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force before the platen moves that changes with the clock."""
    if any(not trial.test.start_known for trial in experiment.trials[1:]):
        return ()
    levels = [(one, level_before(experiment, one)) for one in experiment.trials]
    known = [(trial, level) for trial, level in levels if level is not None]
    if len(known) < _TESTS:
        return ()
    clock = np.array([trial.whole.start_s + float(trial.test.time[0]) for trial, _ in known])
    force, sds = np.array([(level.value, level.sd) for _, level in known]).T
    since = clock - np.average(clock, weights=sds**-2)
    if np.ptp(clock) == 0.0:
        return ()
    sd = float(np.sum((since / sds) ** 2)) ** -0.5
    rate = float(np.sum(since * force / sds**2)) * sd**2
    if abs(rate) <= CLEAR * sd:
        return ()
    off = np.abs(force - np.average(force, weights=sds**-2) - rate * since) / sds
    whole, unit = abs(rate) * float(np.ptp(clock)), experiment.units.force
    places = [Place(rate, sd, trial, "before the ramp") for trial, _ in known]
    several = len(known) > _TESTS and bool(np.max(off) < _AGREE)
    return shown(
        "force_drift", "change of the force before contact with the clock", places, (rate, sd),
        f"{unit}/s",
        f"before the platen moves the force changes by {plain(rate)} +- {plain(sd, 2)} {unit}/s"
        f" from test to test: the load cell drifts",
        sure=several and whole > WANDERS * experiment.peak,
    )  # fmt: skip


def _ramps(trials: Sequence[Trial]) -> list[Press]:
    """Return the loadings of enough readings, in the order of time."""
    every = [
        (trial, move)
        for trial, move, _ in moves_of(trials, "ramp")
        if trial.rows(move.start, move.stop).size >= _FEWEST
    ]
    return sorted(every, key=lambda one: one[0].whole.start_s + one[1].start)


def _fall(experiment: Experiment, earlier: Press, later: Press) -> Place | None:
    """Return by how much the later of two ramps is lower, beyond what relaxation may leave."""
    (one, first), (two, second) = earlier, later
    speeds = mean_speed(one, first), mean_speed(two, second)
    if abs(speeds[1] / speeds[0] - 1.0) > _SAME_SPEED:
        return None
    starts, stops = np.transpose([_ends(*earlier), _ends(*later)])
    if abs(starts[1] - starts[0]) > _SAME_START * experiment.depth:
        return None
    back = next(
        (
            phase
            for phase in one.used_phases
            if phase.kind == "unload" and phase.start >= first.stop
        ),
        None,
    )
    if back is None:
        return None
    since = two.whole.start_s - one.whole.start_s
    rest = since + second.start - back.stop
    if rest <= 0.0:
        return None
    pressed = back.stop - first.start
    bottom, top = float(np.max(starts)), float(np.min(stops))
    depths = np.linspace(bottom, top, _DEPTHS + 2)[2:-1] if top > bottom else np.zeros(0)
    if depths.size == 0:
        return None
    of = [_force_at(trial, move, depths) for trial, move in (earlier, later)]
    memory = min(_REMEMBERED * pressed / rest, 1.0)
    lower = float(np.mean(of[0] - of[1] - memory * np.abs(of[0])))
    of_one = MeanForce(0.0, experiment.floor.total)
    return Place.between(two, second, MeanForce(lower, of_one.sd), of_one, speeds[1])


def _ends(trial: Trial, move: Phase) -> np.ndarray:
    return trial.trajectory.displacement(np.array([move.start, move.stop]))


def _force_at(trial: Trial, move: Phase, depths: np.ndarray) -> np.ndarray:
    rows = trial.rows(move.start, move.stop)
    path = np.maximum.accumulate(trial.trajectory.displacement(trial.test.time[rows]))
    return np.interp(depths, path, trial.test.force[rows])
