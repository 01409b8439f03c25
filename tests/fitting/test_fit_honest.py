"""Are a fit's intervals honest, and is its curve as good as the best that its model can draw?"""

from pathlib import Path

import numpy as np
import pytest

from qlvbayes.diagnosis.checks.samples import rmse
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import fit_pad
from qlvbayes.fitting.least_squares import least_squares
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.fitting.prediction import predict
from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare

ROOT = Path(__file__).parents[2]

QUICK = Settings(max_steps=3000)
REAL = ROOT.parent / "shared" / "real" / "muscle_ramps.csv"


def errors(experiment, choices, constants):
    """Root mean square of measured minus predicted mean (N), over the tests left out."""
    found = predict(experiment, choices, constants, experiment.with_role("validate"))
    return rmse([one.residual for one in found])


def both_errors(experiment, choices):
    """On tests left out: of the fit, and of least squares of the same model and samples."""
    found = fit_pad(experiment, choices, settings=QUICK)
    fitted = {name: found.constants[..., k] for k, name in enumerate(found.names)}
    predictor = predictor_of(experiment, choices, found.trials)
    scale = 1.0 / np.sqrt(predictor.record.blocks.count)
    best = least_squares(predictor, scale, np.random.default_rng(0)).thetas[0]
    (numbers,) = predictor.parameters.constants(best[None])
    nothing = dict.fromkeys(("noise.white", "noise.ou", "noise.remainder"), np.zeros(1))
    squares = dict(zip(predictor.names, numbers[:, None], strict=True)) | nothing
    squares |= {"noise.tau": np.ones(1), "noise.factor": np.ones(1)}
    return errors(experiment, choices, fitted), errors(experiment, choices, squares)


def bundled():
    """Pads of the files that come with the package."""
    files = [ROOT / "data" / name for name in ("pads.csv", "hidden.csv")]
    return [(file, pad.name) for file in files for pad in read_measurements(file).pads]


@pytest.mark.parametrize(("file", "pad"), bundled(), ids=[pad for _, pad in bundled()])
@pytest.mark.parametrize("role", ["fit", "all"])
@pytest.mark.few(1)
def test_the_curve_leaves_what_least_squares_leave_to_within_the_noise(file, pad, role):
    """Of the same model on the same block means: less than the noise of these."""
    experiment = prepare(read_measurements(file).pad(pad), all_tests=role == "all")
    trials = experiment.with_role("fit")
    predictor = predictor_of(experiment, Choices(), trials)
    ones = np.ones(predictor.record.blocks.force.shape)
    squares = least_squares(predictor, ones, np.random.default_rng(0)).thetas[0]
    start = find_start(experiment, Choices(), trials)
    thetas = np.stack([squares, start.normal.mean])
    left = predictor.residuals(predictor.parameters.constants(thetas))
    least, found = (rmse([one[predictor.space.real]]) for one in left)
    noise = rmse([start.spread.discrepancy.whitener.sds])
    assert found <= 1.05 * least or found**2 < least**2 + noise**2
    assert np.diff(start.posterior.log_density(thetas)) > 0.0


@pytest.mark.slow
def test_with_an_effect_hidden_the_curve_is_not_visibly_worse_than_least_squares():
    """The difference is below the noise."""
    experiment = prepare(read_measurements(ROOT / "data" / "hidden.csv").pads[0])
    fit, squares = both_errors(experiment, Choices())
    assert fit < np.hypot(squares, experiment.floor.total)


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_file(), reason="the measurements are not here")
def test_of_a_real_muscle_the_curve_is_as_good_as_least_squares():
    """Correlated noise that swells raised its error by a fifth."""
    experiment = prepare(read_measurements(REAL).pad("calcium"))
    fit, squares = both_errors(experiment, Choices(bonded=True))
    assert fit < 1.1 * squares
