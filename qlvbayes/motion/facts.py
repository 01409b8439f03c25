"""Collect the movements, holds and unloadings of a pad's tests, and the ranges that they cover.

Which parts of a model the tests can show depends on these.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from qlvbayes.io.data import Control
from qlvbayes.io.readings import sampling_of
from qlvbayes.motion.experiment import Experiment, Trial
from qlvbayes.motion.phases import MOVING, Phase

NEARLY = 0.02  # share of the largest depth or force, below which a test counts as back at zero
OF_UNLOADING = ("stress_softening", "permanent_set", "backlash")  # seen as a platen moves back
ROUNDED = 0.1  # of a step of the encoder: where no reading is farther from the motion, it was none
DEEPER = 1.25  # ratio of two depths from which they count as different
_LOADED = 0.05  # of the largest depth (or force, where that is prescribed): a dwell under load
_FEWEST = 5  # readings in a dwell that show how the force goes on in it
_TIMES = 401  # of a movement, at which its speed is looked for
_LATE = 0.1  # of a hold, about its middle and at its end, whose readings are set side by side


@dataclass(frozen=True)
class Movement:
    """A movement: its speed (displacement over s), duration (s) and number of readings."""

    kind: str
    speed: float
    duration: float
    readings: int


@dataclass(frozen=True)
class LoadedDwell:
    """A dwell under load: its level (displacement, or the prescribed force) and duration (s)."""

    control: Control  # which of both is prescribed
    level: float
    duration: float
    change: float  # of the other in its second half, over the pad's largest


@dataclass(frozen=True)
class Facts:
    """All movements, and all dwells under load with enough readings."""

    moves: tuple[Movement, ...]
    holds: tuple[LoadedDwell, ...]
    interval: float  # shortest median time (s) between readings of a test
    loads: int  # ramps of all tests

    @property
    def longest_hold(self) -> float:
        """Duration (s) of the longest hold; 0 without holds."""
        return max((hold.duration for hold in self.holds), default=0.0)

    @property
    def speeds(self) -> list[float]:
        """Speeds of all movements."""
        return [move.speed for move in self.moves]

    @property
    def held(self) -> Control:
        """Quantity that is held: the displacement, or the force where it never is."""
        loaded = all(hold.control == Control.FORCE for hold in self.holds)
        return Control.FORCE if loaded else Control.DISPLACEMENT

    @property
    def levels(self) -> list[float]:
        """Levels of the holds."""
        return [hold.level for hold in self.holds if hold.control == self.held]

    @property
    def durations(self) -> tuple[float, float]:
        """Durations (s) of the shortest and the longest movement."""
        lengths = [move.duration for move in self.moves] or [0.0]
        return min(lengths), max(lengths)


def facts_of(experiment: Experiment) -> Facts:
    """Collect movements and holds from the phases of all tests."""
    every = [(trial, phase) for trial in experiment.trials for phase in trial.used_phases]
    moves = tuple(move_of(trial, phase) for trial, phase in every if phase.kind in MOVING)
    holds = (_hold(experiment, trial, phase) for trial, phase in every)
    # of an uneven record the short ones, which are where it changes quickly
    interval = min(sampling_of(trial.test.time).low for trial in experiment.trials)
    loads = sum(move.kind == "ramp" for move in moves)
    return Facts(moves, tuple(hold for hold in holds if hold is not None), interval, loads)


def move_of(trial: Trial, phase: Phase) -> Movement:
    """Return a movement, with the speed over the middle 60 % of its stroke."""
    time = np.linspace(phase.start, phase.stop, _TIMES)
    depth = trial.trajectory.displacement(time)
    depth = np.maximum.accumulate(np.abs(depth - depth[0]))
    early, late = np.interp([0.2 * depth[-1], 0.8 * depth[-1]], depth, time)
    speed = 0.6 * float(depth[-1] / (late - early)) if late > early else 0.0
    return Movement(
        phase.kind, speed, phase.stop - phase.start, trial.rows(phase.start, phase.stop).size
    )


def _hold(experiment: Experiment, trial: Trial, phase: Phase) -> LoadedDwell | None:
    """Return a hold; None if it moves, bears no load or has too few readings."""
    inside = trial.rows(phase.start, phase.stop)
    if phase.kind in MOVING or inside.size < _FEWEST:
        return None
    held, answer = trial.test.displacement[inside], trial.test.force[inside]
    largest, of_answer = experiment.depth, experiment.peak
    if phase.control == Control.FORCE:
        held, answer, largest, of_answer = answer, held, of_answer, largest
    level = float(np.median(held))
    if (abs(level) if experiment.units.dimensionless else level) < _LOADED * largest:
        return None  # before contact, or back at zero
    time = trial.test.time[inside]
    duration = float(time[-1] - time[0])
    spare = 0.5 * _LATE * duration
    at_middle = answer[np.abs(time - (phase.start + 0.5 * duration)) <= spare]
    change = 0.0
    if at_middle.size and of_answer > 0.0:
        at_end = answer[time >= time[-1] - spare]
        change = float(np.mean(at_end) - np.mean(at_middle)) / of_answer
    return LoadedDwell(phase.control, level, phase.stop - phase.start, change)


def noise_of(experiment: Experiment) -> float:
    """Return the sd of the median reading: the floor's, or that of the measured sds."""
    sds = [t.test.force_sd for t in experiment.trials if t.test.force_sd is not None]
    if not sds:
        return experiment.floor.total
    return experiment.floor.total * float(np.median(np.concatenate(sds))) / experiment.sd_scale


def _depths(trial: Trial, phase: Phase) -> list[float]:
    """Return the depths at which a phase begins and ends."""
    begin, end = trial.trajectory.displacement([phase.start, phase.stop])
    return [float(begin), float(end)]


def unloads(experiment: Experiment, nearly: float = NEARLY) -> bool:
    """Return whether a test moves back by more than the fitted motion may ripple."""
    return any(
        -np.diff(_depths(trial, phase))[0] > nearly * experiment.depth
        for trial in experiment.trials
        for phase in trial.used_phases
        if phase.kind == "unload"
    )


def returns(experiment: Experiment, nearly: float = NEARLY) -> bool:
    """Return whether an unloading ends at zero depth, or the force vanishes in or after it."""
    little = max(nearly * experiment.peak, 3.0 * experiment.floor.total)
    for trial in experiment.trials:
        for phase in trial.used_phases:
            if phase.kind in ("unload", "recovery"):
                inside = (trial.test.time >= phase.start) & (trial.test.time <= phase.stop)
                if _depths(trial, phase)[1] < nearly * experiment.depth:
                    return True
                if np.any(trial.test.force[inside] < little):
                    return True
    return False


def loaded_once(experiment: Experiment) -> bool:
    """Return whether there is one test, all of whose loads after the first go no deeper."""
    if len(experiment.trials) > 1:
        return False
    (trial,) = experiment.trials
    depths = [abs(_depths(trial, p)[1]) for p in trial.phases if p.kind == "ramp"]
    return bool(depths) and max(depths) < DEEPER * depths[0]


def at_one_depth(experiment: Experiment, nearly: float = NEARLY) -> bool:
    """Return whether all rests in contact are at one depth."""
    ends = [
        _depths(trial, phase)[1]
        for trial in experiment.trials
        for phase in trial.used_phases
        if phase.kind not in MOVING and phase.control == Control.DISPLACEMENT
    ]
    apart = nearly * experiment.depth
    pressed = [depth for depth in ends if depth > apart]
    return bool(pressed) and max(pressed) - min(pressed) < apart


@dataclass(frozen=True)
class Covered:
    """Ranges of depth, speed and time of one pad's tests, outside which a model extrapolates."""

    depth: float  # largest depth
    # slowest, fastest: loading rates, in the pad's units
    slowest: float
    fastest: float
    quickest: float  # duration of the shortest ramp (s)
    hold: float  # duration of the longest dwell (s)
    tests: int  # how many

    def as_dict(self) -> dict[str, float]:
        """Return plain values for JSON."""
        return asdict(self)

    def times(self, factor: float) -> Covered:
        """Return the ranges in a unit of displacement that is 1/factor as large."""
        sizes = {name: factor * getattr(self, name) for name in ("depth", "slowest", "fastest")}
        return replace(self, **sizes)


def covered(experiment: Experiment) -> Covered:
    """Return the ranges of a pad's tests; without a dwell ``hold`` is the longest phase."""
    trials = experiment.trials
    lengths: dict[bool, list[float]] = {True: [], False: []}
    loading = []
    for trial in trials:
        used = trial.used_phases
        for phase in used:
            if phase.kind != "unload":
                lengths[phase.kind == "ramp"].append(phase.stop - phase.start)
        if any(p.kind == "ramp" for p in used) or all(p.kind != "ramp" for p in trial.phases):
            loading.append(trial)
    every = [p.stop - p.start for trial in trials for p in trial.used_phases]
    rates = [trial.rate for trial in loading or trials if np.isfinite(trial.rate)]
    return Covered(
        depth=max(float(np.max(trial.test.displacement)) for trial in trials),
        slowest=float(min(rates)),
        fastest=float(max(rates)),
        quickest=float(min(lengths[True] or every)),
        hold=float(max(lengths[False] or every)),
        tests=len(trials),
    )
