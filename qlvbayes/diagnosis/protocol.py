"""What a study's tests do, as far as it decides which effects they can show."""

from __future__ import annotations

import numpy as np

from qlvbayes.diagnosis.settings import Settings
from qlvbayes.effects.effect import Protocol
from qlvbayes.preprocess.experiment import Experiment, Trial


def protocol_of(
    experiment: Experiment, *, bonded: bool, settings: Settings | None = None
) -> Protocol:
    """Read off the tests' phases, motion and forces."""
    nearly = (settings or Settings()).returned
    return Protocol(
        unloads=any(_unloads(experiment, trial, nearly) for trial in experiment.trials),
        returns=any(_returns(experiment, trial, nearly) for trial in experiment.trials),
        tests=len(experiment.trials),
        bonded=bonded,
        curved=any(trial.trajectory.acceleration_resolved for trial in experiment.trials),
        timed=any(trial.trajectory.velocity_resolved for trial in experiment.trials),
        one_depth=_holds_at_one_depth(experiment, nearly),
    )


def _holds_at_one_depth(experiment: Experiment, nearly: float) -> bool:
    """Whether tests rest in contact at a depth, and none of them at another one."""
    ends = [
        float(trial.trajectory.displacement(np.array([phase.stop]))[0])
        for trial in experiment.trials
        if trial.control == "displacement"
        for phase in trial.phases
        if phase.kind in ("hold", "recovery")
    ]
    apart = nearly * experiment.scales.depth
    pressed = [depth for depth in ends if depth > apart]
    return bool(pressed) and max(pressed) - min(pressed) < apart


def _unloads(experiment: Experiment, trial: Trial, nearly: float) -> bool:
    """Whether a phase moves back by more than the fitted motion may ripple."""
    ends = [(p.start, p.stop) for p in trial.phases if p.kind == "unload"]
    way = [-np.diff(trial.trajectory.displacement(np.array(pair)))[0] for pair in ends]
    return any(back > nearly * experiment.scales.depth for back in way)


def _returns(experiment: Experiment, trial: Trial, nearly: float) -> bool:
    """Whether an unloading ends at zero depth, or the force comes to nothing in it or after it."""
    scales = experiment.scales
    little = max(nearly * scales.force, 3.0 * experiment.floor.total)
    for phase in trial.phases:
        if phase.kind not in ("unload", "recovery"):
            continue
        if float(trial.trajectory.displacement(np.array([phase.stop]))[0]) < nearly * scales.depth:
            return True
        inside = (trial.test.time >= phase.start) & (trial.test.time <= phase.stop)
        if np.any(trial.test.force[inside] < little):
            return True
    return False
