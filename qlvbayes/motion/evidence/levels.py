"""What direct evidence consists of: levels of force with their errors, and where they were seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.files import Part
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import MOVING, Phase

Rows = NDArray[np.intp]  # indices of readings
CLEAR = 5.0  # errors, from which on a size is beyond doubt where it is seen in two places
AT_ZERO = 0.01  # of the depth, within which the platen has not left the file's zero
AROUND = 5  # readings whose mean is a level, before and after a start
REACHED = 0.9  # of a movement's mean speed, at which its start is over
HALF = 0.5  # of a mass, by which single starts may differ; of a pull, by which a drag falls at once


class DirectEvidence(Part, frozen=True):
    """An effect that shows in the readings themselves, without any model."""

    effect: str
    # the measured quantity: its name, its value and error, and their unit
    quantity: str
    value: float
    sd: float
    unit: str
    # where it was seen
    tests: tuple[str, ...]
    phases: tuple[str, ...]
    sentence: str
    # whether it is five errors large, seen in two places, and more than other effects would make
    beyond_doubt: bool


class Level(NamedTuple):
    """Mean of some readings of force, and its sd."""

    value: float
    sd: float


@dataclass(frozen=True)
class Place:
    """A quantity in one phase of one test, and the speed (displacement over s) of its movement."""

    trial: Trial
    phase: str
    value: float
    sd: float
    speed: float = 0.0

    @property
    def is_clear(self) -> bool:
        """True if the value is positive by five errors."""
        return self.value >= CLEAR * self.sd > 0.0


def told(
    effect: str, quantity: str, level: Level, unit: str, places: Sequence[Place], sentence: str,
    sure: bool,
) -> DirectEvidence:  # fmt: skip
    """Return the evidence of an effect, seen in these places."""
    tests = tuple(dict.fromkeys(one.trial.name for one in places))
    phases = tuple(dict.fromkeys(one.phase for one in places))
    return DirectEvidence(effect, quantity, *level, unit, tests, phases, sentence, sure)


def moves_of(trial: Trial) -> list[tuple[Phase, Phase | None]]:
    """Return each movement with the rest after it, None where another one follows."""
    phases = trial.used_phases
    return [
        (phase, after if after is not None and after.kind not in MOVING else None)
        for phase, after in zip(phases, (*phases[1:], None), strict=True)
        if phase.kind in MOVING
    ]


def mean_speed(trial: Trial, move: Phase) -> float:
    """Return the mean speed of a movement, without its sign."""
    begin, end = trial.trajectory.displacement(np.array([move.start, move.stop]))
    return abs(float(end - begin)) / (move.stop - move.start)


def rows_between(trial: Trial, start: float, stop: float) -> Rows:
    """Return the indices of the readings from a time to another."""
    return np.arange(*np.searchsorted(trial.test.time, [start, stop]))


def level_of(experiment: Experiment, trial: Trial, rows: Rows) -> Level | None:
    """Return the mean force of readings; None of fewer than three. Slow noise is not averaged."""
    if rows.size < 3:
        return None
    floor, test = experiment.floor, trial.test
    white = floor.white
    if test.force_sd is not None:
        white *= float(np.mean(test.force_sd[rows])) / experiment.sd_scale
    sd = float(np.hypot(white / np.sqrt(rows.size), floor.ou))
    return Level(float(np.mean(test.force[rows])), max(sd, 1e-9 * experiment.peak))


def pooled(places: Sequence[Place]) -> Level:
    """Return the mean over places, weighted by their errors, and its error with their scatter."""
    values, sds = np.array([(one.value, one.sd) for one in places]).T
    weights = 1.0 / sds**2
    scatter = float(np.std(values)) / np.sqrt(max(values.size - 1, 1))
    sd = float(np.hypot(1.0 / np.sqrt(weights.sum()), scatter))
    return Level(float(weights @ values / weights.sum()), sd)
