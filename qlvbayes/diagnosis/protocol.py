"""The features of a study's tests that decide which effects they can show."""

from __future__ import annotations

from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.effect import Protocol
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.firstlook.facts import at_one_depth, returns, unloads


def protocol_of(
    experiment: Experiment, *, bonded: bool, settings: DiagnosisSettings | None = None
) -> Protocol:
    """Return the protocol of an experiment, from the phases, motion and forces of its tests.

    Parameters
    ----------
    experiment
        The tests of one pad.
    bonded
        Whether the specimen is fixed to the platen.
    settings
        ``returned`` is the share of the largest depth or force below which a test has come back.
    """
    nearly = (settings or DiagnosisSettings()).returned
    return Protocol(
        unloads=unloads(experiment, nearly),
        returns=returns(experiment, nearly),
        tests=len(experiment.trials),
        bonded=bonded,
        curved=any(trial.trajectory.acceleration_resolved for trial in experiment.trials),
        timed=any(trial.trajectory.velocity_resolved for trial in experiment.trials),
        one_depth=at_one_depth(experiment, nearly),
        interval=experiment.scales.shortest,
    )
