"""A piece of direct evidence, and levels of force with their errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from qlvbayes.io.arrays import Mask
from qlvbayes.io.data import Control
from qlvbayes.io.files import Part
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.falling import speed_changes
from qlvbayes.motion.phases import MOVING, Phase

Rows = NDArray[np.intp]
"""Indices of readings."""
CLEAR = 5.0
"""Errors, from which on a size is beyond doubt where it is seen in two places."""
AGREE = 3.0
"""Errors, within which places have one value, or forces lie on one line."""
WANDERS = 0.02
"""Of the peak: a smaller change of the force off the specimen may be a tare that wanders."""
FEWEST = 3
"""Readings of a level."""
_STILL = 2.0  # encoder steps, within which the platen has not left its start
_NEAR = 3  # readings about a change of the speed, where a moved mass pulls


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

    @property
    def is_clear(self) -> bool:
        """True if the value is positive by five errors."""
        return self.value >= CLEAR * self.sd > 0.0


@dataclass(frozen=True)
class Place(MeanForce):
    """A quantity in one phase of one test, and the speed (displacement over s) of its movement."""

    trial: Trial
    phase: str
    speed: float = 0.0


@dataclass(frozen=True)
class Levels:
    """One test of an experiment, whose levels of force are compared."""

    experiment: Experiment
    trial: Trial

    def level(self, rows: Rows) -> MeanForce | None:
        """Return the mean force of readings; None of fewer than three. Slow noise is no mean's."""
        if rows.size < FEWEST:
            return None
        floor, test = self.experiment.floor, self.trial.test
        white = floor.white
        if test.force_sd is not None:
            white *= float(np.mean(test.force_sd[rows])) / self.experiment.sd_scale
        sd = float(np.hypot(white / np.sqrt(rows.size), floor.ou))
        return MeanForce(float(np.mean(test.force[rows])), max(sd, 1e-9 * self.experiment.peak))

    def levels(self, parts: Sequence[Rows]) -> list[MeanForce] | None:
        """Return the force of each of some parts; None where one has too few readings."""
        known = [level for rows in parts if (level := self.level(rows)) is not None]
        return known if len(known) == len(parts) else None

    @cached_property
    def before(self) -> MeanForce | None:
        """Force before the platen first moves; None where no rest precedes that."""
        first, path, time = self.first_ramp, self.trial.trajectory, self.trial.test.time
        if first is None:
            return None
        start, depth = path.displacement(np.array([time[0], first.stop]))
        if start > 0.01 * self.experiment.depth:  # pressed already
            return None
        least = max(_STILL * path.resolution, 1e-3 * abs(depth - start))
        gone = np.flatnonzero(np.abs(path.displacement(time) - start) > least)
        rests = int(np.searchsorted(time, first.start, side="right"))
        return self.level(np.arange(min(rests, *gone[:1], time.size)))

    @property
    def first_ramp(self) -> Phase | None:
        """First loading of the test, if its displacement was prescribed."""
        first = self.trial.first_ramp
        return first if first is not None and first.control == Control.DISPLACEMENT else None

    @cached_property
    def steady(self) -> Mask:
        """Which readings (n,) are no nearer than three to a sharp change of the speed."""
        return ~speed_changes(self.trial.test, self.trial.trajectory, _NEAR)

    def moves(self, *kinds: str) -> Iterator[tuple[Phase, Phase | None]]:
        """Yield movements of prescribed displacement, and the rest after each, if there is one."""
        phases = self.trial.used_phases
        for phase, after in zip(phases, (*phases[1:], None), strict=True):
            if phase.kind in (kinds or MOVING) and phase.control == Control.DISPLACEMENT:
                yield phase, None if after is None or after.kind in MOVING else after

    def speed(self, move: Phase) -> float:
        """Return the mean speed of a movement, without its sign."""
        begin, end = self.trial.trajectory.displacement(np.array([move.start, move.stop]))
        return abs(float(end - begin)) / (move.stop - move.start)

    def fall(self, phase: Phase, above: MeanForce, below: MeanForce, speed: float) -> Place:
        """Return the difference of two levels of force."""
        sd = float(np.hypot(above.sd, below.sd))
        return Place(above.value - below.value, sd, self.trial, phase.kind, speed)


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


def pooled(places: Sequence[Place]) -> tuple[float, float]:
    """Return the mean over places, weighted by their errors, and its error with their scatter."""
    values, sds = np.array([(one.value, one.sd) for one in places]).T
    weights = 1.0 / sds**2
    mean = float(weights @ values / weights.sum())
    scatter = float(np.std(values)) / np.sqrt(max(values.size - 1, 1))
    return mean, float(np.hypot(1.0 / np.sqrt(weights.sum()), scatter))
