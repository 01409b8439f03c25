"""What a study's tests do, as far as it decides which effects they can show."""

from __future__ import annotations

from qlvbayes.diagnosis.settings import Settings
from qlvbayes.effects.effect import Protocol
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.firstlook.facts import at_one_depth, returns, unloads


def protocol_of(
    experiment: Experiment, *, bonded: bool, settings: Settings | None = None
) -> Protocol:
    """Read off the tests' phases, motion and forces."""
    nearly = (settings or Settings()).returned
    return Protocol(
        unloads=unloads(experiment, nearly),
        returns=returns(experiment, nearly),
        tests=len(experiment.trials),
        bonded=bonded,
        curved=any(trial.trajectory.acceleration_resolved for trial in experiment.trials),
        timed=any(trial.trajectory.velocity_resolved for trial in experiment.trials),
        one_depth=at_one_depth(experiment, nearly),
    )
