"""Direct evidence from tests set side by side: contact, softening, a leak, a drift of the force."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from qlvbayes.io.contact import FirstContact, first_rises, most_slide
from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.levels import (
    AGREE,
    CLEAR,
    WANDERS,
    DirectEvidence,
    Levels,
    Place,
    off_their_mean,
    pooled,
    shown,
)
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.phases import Phase

_AT_ZERO = 0.01  # of the depth, within which the platen has not left the file's zero
_SAME_SPEED = 0.05  # of the speed, within which two ramps are equal
_SAME_START = 0.01  # of the depth, within which two ramps begin alike
_DEPTHS = 5  # depths at which two ramps are set side by side
_FEWEST = 12  # readings of a ramp
_TESTS = 3  # tests whose forces before contact show a drift; one more, and it is beyond doubt
Press = tuple[Levels, Phase]
"""Loading of a test."""
_REMEMBERED = float(np.exp(-1.0))
"""Most that a press of a time T leaves of the force after a rest R, over T/R.

A mode of relaxation time s relaxes by T/s at most in the press, and of that e^{-R/s} is left;
T/s e^{-R/s} is largest at s = R.
"""


def contacts_of(experiment: Experiment) -> list[FirstContact | None]:
    """Return where the force of each test begins to rise; None if no approach shows it."""
    found: list[tuple[FirstContact | None, FirstContact | None]] = []
    for trial in experiment.trials:
        first, contact, later = trial.first_ramp or trial.phases[0], None, None
        if not experiment.units.dimensionless and first.control != Control.FORCE:
            way, force = trial.test.displacement, trial.test.force
            at_zero = abs(float(way[0])) <= _AT_ZERO * experiment.depth
            contact, later = first_rises(way, force, at_zero=at_zero)
        found.append((contact if contact is not None and contact.is_finite else None, later))
    slides = most_slide([later for _, later in found])
    return [later if slides and later else first for first, later in found]


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
        sure=early and off_their_mean(places, size) < AGREE,
    )  # fmt: skip


def repeated_seen(tests: Sequence[Levels]) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a later ramp below an earlier one, at equal depth and speed.

    What a relaxation of any time may have left of the earlier press after the rest between both is
    taken off. Softening, a set, conditioning and a leak all lower the force: one of them is there,
    and none by itself is beyond doubt.
    """
    known = all(test.trial.test.start_known for test in tests[1:])
    clear = [
        place
        for some in ([tests] if known else [[one] for one in tests])
        for pair in pairwise(_ramps(some))
        if (place := _fall(*pair)) is not None and place.is_clear
    ]
    if not clear:
        return ()
    largest = max(clear, key=lambda one: one.value / one.sd)
    unit = tests[0].experiment.units.force
    return shown(
        "stress_softening", "fall of the force from a loading to the next", clear,
        (largest.value, largest.sd), unit,
        f"at equal depth, speed and rest a later loading is lower by {plain(largest.value)} +- "
        f"{plain(largest.sd, 2)} {unit} than an earlier one: it softens, sets or leaks",
        sure=False,  # which of them it is, these loadings do not show
    )  # fmt: skip


def _ramps(tests: Sequence[Levels]) -> list[Press]:
    """Return the loadings of enough readings, in the order of time."""
    every = [
        (test, move)
        for test in tests
        for move, _ in test.moves("ramp")
        if test.trial.rows(move.start, move.stop).size >= _FEWEST
    ]
    return sorted(every, key=lambda one: one[0].trial.whole.start_s + one[1].start)


def _fall(earlier: Press, later: Press) -> Place | None:
    """Return by how much the later of two ramps is lower, beyond what relaxation may leave."""
    (one, first), (two, second) = earlier, later
    experiment, speed = one.experiment, two.speed(second)
    ends = ([move.start, move.stop] for move in (first, second))
    paths = one.trial.trajectory, two.trial.trajectory
    starts, stops = np.transpose(
        [path.displacement(at) for path, at in zip(paths, ends, strict=True)]
    )
    bottom, top = float(np.max(starts)), float(np.min(stops))
    after = (phase for phase in one.trial.used_phases if phase.start >= first.stop)
    back = next((phase.stop for phase in after if phase.kind == "unload"), np.inf)
    rest = two.trial.whole.start_s - one.trial.whole.start_s + second.start - back
    alike = abs(speed / one.speed(first) - 1.0) <= _SAME_SPEED
    alike = alike and abs(starts[1] - starts[0]) <= _SAME_START * experiment.depth
    if not (alike and rest > 0.0 and top > bottom):
        return None
    depths = np.linspace(bottom, top, _DEPTHS + 2)[2:-1]
    before, now = (_force_at(*press, depths) for press in (earlier, later))
    memory = min(_REMEMBERED * (back - first.start) / rest, 1.0)
    lower = float(np.mean(before - now - memory * np.abs(before)))
    sd = np.sqrt(2.0) * experiment.floor.total
    return Place(lower, float(sd), two.trial, second.kind, speed)


def _force_at(test: Levels, move: Phase, depths: np.ndarray) -> np.ndarray:
    trial, rows = test.trial, test.trial.rows(move.start, move.stop)
    path = np.maximum.accumulate(trial.trajectory.displacement(trial.test.time[rows]))
    return np.interp(depths, path, trial.test.force[rows])


def drift_seen(tests: Sequence[Levels]) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a force before the platen moves that changes with the clock."""
    known = [(test.trial, test.before) for test in tests if test.before is not None]
    if len(known) < _TESTS or any(not test.trial.test.start_known for test in tests[1:]):
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
    experiment = tests[0].experiment
    whole, unit = abs(rate) * float(np.ptp(clock)), experiment.units.force
    places = [Place(rate, sd, trial, "before the ramp") for trial, _ in known]
    several = len(known) > _TESTS and bool(np.max(off) < AGREE)
    return shown(
        "force_drift", "change of the force before contact with the clock", places, (rate, sd),
        f"{unit}/s",
        f"before the platen moves the force changes by {plain(rate)} +- {plain(sd, 2)} {unit}/s"
        f" from test to test: the load cell drifts",
        sure=several and whole > WANDERS * experiment.peak,
    )  # fmt: skip
