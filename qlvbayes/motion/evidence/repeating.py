"""Direct evidence from tests that are repeated: softening, a leak, and a drift of the force."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from qlvbayes.io.data import Control
from qlvbayes.io.wording import plain
from qlvbayes.motion.evidence.record import (
    CLEAR,
    WANDERS,
    DirectEvidence,
    Place,
    level_before,
    mean_speed,
    moves_of,
    names_of,
    rows_between,
)
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import Phase

_SAME_SPEED = 0.05  # of the speed, within which two ramps are equal
_SAME_START = 0.01  # of the depth, within which two ramps begin alike
_DEPTHS = 5  # depths at which two ramps are set side by side
_FEWEST = 12  # readings of a ramp
_TESTS = 3  # tests whose forces before contact show a drift; one more, and it is beyond doubt
_ALIKE = 3.0  # errors, within which these forces lie on one line
_REMEMBERED = float(np.exp(-1.0))
"""Most that a press of a time T leaves of the force after a rest R, over T/R.

A mode of relaxation time s relaxes by T/s at most in the press, and of that e^{-R/s} is left;
T/s e^{-R/s} is largest at s = R.
"""


def repeated_seen(experiment: Experiment) -> tuple[DirectEvidence, ...]:
    """Return the evidence of a later ramp below an earlier one, at equal depth and speed.

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
        return ()
    largest = max(clear, key=lambda one: one.value / one.sd)
    tests, phases = names_of(clear)
    unit = experiment.units.force
    return (
        DirectEvidence(
            "stress_softening", "fall of the force from a loading to the next", largest.value,
            largest.sd, unit, tests, phases,
            f"at equal depth, speed and rest a later loading is lower by {plain(largest.value)} +- "
            f"{plain(largest.sd, 2)} {unit} than an earlier one: it softens, sets or leaks",
            False,  # which of them it is, these loadings do not show
        ),
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
    force = np.array([level.value for _, level in known])
    sds = np.array([level.sd for _, level in known])
    since = clock - np.average(clock, weights=sds**-2)
    sd = float(np.sum((since / sds) ** 2)) ** -0.5 if np.ptp(clock) > 0.0 else np.inf
    rate = float(np.sum(since * force / sds**2)) * sd**2 if np.isfinite(sd) else 0.0
    if abs(rate) <= CLEAR * sd:
        return ()
    off = np.abs(force - np.average(force, weights=sds**-2) - rate * since) / sds
    whole, peak = abs(rate) * float(np.ptp(clock)), experiment.peak
    unit = experiment.units.force
    places = [Place(trial, "before the ramp", rate, sd) for trial, _ in known]
    tests, phases = names_of(places)
    return (
        DirectEvidence(
            "force_drift", "change of the force before contact with the clock", rate, sd,
            f"{unit}/s", tests, phases,
            f"before the platen moves the force changes by {plain(rate)} +- {plain(sd, 2)} {unit}/s"
            f" from test to test: the load cell drifts",
            len(known) > _TESTS and bool(np.max(off) < _ALIKE) and whole > WANDERS * peak,
        ),
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
    starts, stops = np.transpose([_ends(*earlier), _ends(*later)])
    if abs(starts[1] - starts[0]) > _SAME_START * experiment.depth:
        return None
    back = next(
        (move for move, _ in moves_of(one) if move.kind == "unload" and move.start >= first.stop),
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
    sd = float(np.sqrt(2.0) * experiment.floor.total)
    return Place(two, "ramp", lower, sd, speeds[1])


def _ends(trial: Trial, move: Phase) -> np.ndarray:
    return trial.trajectory.displacement(np.array([move.start, move.stop]))


def _force_at(trial: Trial, move: Phase, depths: np.ndarray) -> np.ndarray:
    rows = rows_between(trial, move.start, move.stop)
    path = np.maximum.accumulate(trial.trajectory.displacement(trial.test.time[rows]))
    return np.interp(depths, path, trial.test.force[rows])
