"""A piece of direct evidence, and levels of force with their errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.data import Control
from qlvbayes.io.files import Part
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import MOVING, Phase

Rows = NDArray[np.intp]
"""Indices of readings."""
CLEAR = 5.0
"""Errors, from which on a size is beyond doubt where it is seen in two places."""
WANDERS = 0.02
"""Of the peak: a smaller change of the force off the specimen may be a tare that wanders."""
FEWEST = 3
"""Readings of a level."""
_STILL = 2.0  # encoder steps, within which the platen has not left its start


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


@dataclass(frozen=True)
class MeanForce:
    """Mean of some readings of force, and its sd."""

    value: float
    sd: float


@dataclass(frozen=True)
class Place(MeanForce):
    """A quantity in one phase of one test, and the speed (displacement over s) of its movement."""

    trial: Trial
    phase: str
    speed: float = 0.0

    @classmethod
    def between(
        cls, trial: Trial, phase: Phase, above: MeanForce, below: MeanForce, speed: float = 0.0
    ) -> Place:
        """Return the difference of two levels of force."""
        sd = float(np.hypot(above.sd, below.sd))
        return cls(above.value - below.value, sd, trial, phase.kind, speed)

    @property
    def is_clear(self) -> bool:
        """True if the value is positive by five errors."""
        return self.value >= CLEAR * self.sd > 0.0


def shown(
    effect: str, quantity: str, places: Sequence[Place], size: tuple[float, float], unit: str,
    sentence: str, *, sure: bool,
) -> tuple[DirectEvidence, ...]:  # fmt: skip
    """Return the evidence of a quantity of one size and error, seen in some places."""
    tests = tuple(dict.fromkeys(one.trial.name for one in places))
    phases = tuple(dict.fromkeys(one.phase for one in places))
    return (DirectEvidence(effect, quantity, *size, unit, tests, phases, sentence, sure),)


def off_their_mean(places: Sequence[Place], size: tuple[float, float]) -> float:
    """Return the largest distance of places from their mean, in errors of both."""
    value, sd = size
    return max(abs(one.value - value) / float(np.hypot(one.sd, sd)) for one in places)


def level_of(experiment: Experiment, trial: Trial, rows: Rows) -> MeanForce | None:
    """Return the mean force of readings; None of fewer than three. Slow noise is not averaged."""
    if rows.size < FEWEST:
        return None
    floor, test = experiment.floor, trial.test
    white = floor.white
    if test.force_sd is not None:
        white *= float(np.mean(test.force_sd[rows])) / experiment.sd_scale
    sd = float(np.hypot(white / np.sqrt(rows.size), floor.ou))
    return MeanForce(float(np.mean(test.force[rows])), max(sd, 1e-9 * experiment.peak))


def level_before(experiment: Experiment, trial: Trial) -> MeanForce | None:
    """Return the force before the platen first moves; None where no rest precedes that."""
    first = first_ramp(trial)
    if first is None:
        return None
    path, test = trial.trajectory, trial.test
    start, depth = path.displacement(np.array([test.time[0], first.stop]))
    if start > 0.01 * experiment.depth:  # pressed already
        return None
    near = np.abs(path.displacement(test.time) - start) <= max(
        _STILL * path.resolution, 1e-3 * abs(depth - start)
    )
    leaves = int(np.argmin(near)) if not np.all(near) else near.size
    rests = int(np.searchsorted(test.time, first.start, side="right"))
    return level_of(experiment, trial, np.arange(min(leaves, rests)))


def first_ramp(trial: Trial) -> Phase | None:
    """Return the first loading of a test, if its displacement was prescribed."""
    first = trial.first_ramp
    return first if first is not None and first.control == Control.DISPLACEMENT else None


def moves_of(trials: Sequence[Trial], *kinds: str) -> Iterator[tuple[Trial, Phase, Phase | None]]:
    """Yield movements of prescribed displacement, and the rest after each, if there is one."""
    for trial in trials:
        phases = trial.used_phases
        for phase, after in zip(phases, (*phases[1:], None), strict=True):
            if phase.kind in (kinds or MOVING) and phase.control == Control.DISPLACEMENT:
                still = after is not None and after.kind not in MOVING
                yield trial, phase, after if still else None


def mean_speed(trial: Trial, move: Phase) -> float:
    """Return the mean speed of a movement, without its sign."""
    begin, end = trial.trajectory.displacement(np.array([move.start, move.stop]))
    return abs(float(end - begin)) / (move.stop - move.start)


def pooled(places: Sequence[Place]) -> tuple[float, float]:
    """Return the mean over places, weighted by their errors, and its error with their scatter."""
    values, sds = np.array([(one.value, one.sd) for one in places]).T
    weights = 1.0 / sds**2
    mean = float(weights @ values / weights.sum())
    scatter = float(np.std(values)) / np.sqrt(max(values.size - 1, 1))
    return mean, float(np.hypot(1.0 / np.sqrt(weights.sum()), scatter))


def exponent(places: Sequence[Place]) -> tuple[float, float] | None:
    """Return by which power of the speed a quantity grows, and its error.

    None where the speeds do not differ by a factor of two.
    """
    speeds = np.log([one.speed for one in places])
    if np.ptp(speeds) < np.log(2.0):
        return None
    sizes = np.log([one.value for one in places])
    errors = np.array([one.sd / one.value for one in places])
    off = speeds - np.average(speeds, weights=errors**-2)
    spread = float(np.sum((off / errors) ** 2))
    slope = float(np.sum(off * sizes / errors**2)) / spread
    return slope, 1.0 / float(np.sqrt(spread))
