"""A saved fit against its data: predictions of every test, and where they fail."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.fitting.prediction import Prediction, predict
from qlvbayes.fitting.residuals import CheckResult, check_experiment
from qlvbayes.fitting.results import Saved
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad
from qlvbayes.model.conversion import factors
from qlvbayes.model.elsewhere import has_noise
from qlvbayes.preprocess.experiment import Experiment, prepare


@dataclass(frozen=True, eq=False)
class CheckedPad:
    """The tests of one pad, what was predicted of each, and the cells of test and phase."""

    experiment: Experiment
    predictions: tuple[Prediction, ...]
    check: CheckResult


def check_pad(saved: Saved, pad: Pad, *, seed: int = 0) -> CheckedPad:
    """Predict all tests of ``pad`` from a saved posterior.

    Tests keep the role they had in the fit, so that fitted ones are not taken for predictions.
    Constants in other units than the pad's are converted.
    Raises InputError where the posterior, made elsewhere, has no noise to predict with.
    """
    if not has_noise(saved.names):
        raise InputError(
            f"the posterior of pad {saved.pad} has no noise",
            remedy="give draws of noise.white, or also of noise.ou and noise.tau",
        )
    experiment = prepare(pad, all_tests=saved.all_tests)
    constants = dict(zip(saved.names, saved.draws.T, strict=True))
    by = factors(saved.choices, constants, saved.units, pad.units)
    constants = {name: by[name] * draws for name, draws in constants.items()}
    predictions = predict(experiment, saved.choices, constants, experiment.trials, seed=seed)
    found = check_experiment(experiment, saved.choices, predictions)
    return CheckedPad(experiment, tuple(predictions), found)
