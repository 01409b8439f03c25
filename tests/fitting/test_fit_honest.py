"""Is a fit's curve as good as the best that its model can draw?"""

from pathlib import Path

import numpy as np
import pytest

from qlvbayes.diagnosis.checks.samples import rmse
from qlvbayes.fitting.least_squares import least_squares
from qlvbayes.fitting.optimum import find_start, predictor_of
from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare

ROOT = Path(__file__).parents[2]
REAL = ROOT.parent / "shared" / "real" / "muscle_ramps.csv"


def pads():
    """Pads of the files that come with the package, and a real muscle, where it is here."""
    files = [ROOT / "data" / name for name in ("pads.csv", "hidden.csv")]
    every = [(file, pad.name) for file in files for pad in read_measurements(file).pads]
    return [*every, (REAL, "calcium")] if REAL.is_file() else every


@pytest.mark.parametrize(("file", "pad"), pads(), ids=[pad for _, pad in pads()])
@pytest.mark.parametrize("role", ["fit", "all"])
@pytest.mark.few(1)
def test_the_curve_leaves_what_least_squares_leave_to_within_the_noise(file, pad, role):
    """Of the same model on the same block means: less than the noise of these."""
    experiment = prepare(read_measurements(file).pad(pad), all_tests=role == "all")
    trials, choices = experiment.with_role("fit"), Choices(bonded=file == REAL)
    predictor = predictor_of(experiment, choices, trials)
    ones = np.ones(predictor.record.blocks.force.shape)
    squares = least_squares(predictor, ones, np.random.default_rng(0)).thetas[0]
    start = find_start(experiment, choices, trials)
    thetas = np.stack([squares, start.normal.mean])
    left = predictor.residuals(predictor.parameters.constants(thetas))
    least, found = (rmse([one[predictor.space.real]]) for one in left)
    noise = rmse([start.spread.discrepancy.whitener.sds])
    assert found <= 1.05 * least or found**2 < least**2 + noise**2
    assert np.diff(start.posterior.log_density(thetas)) > 0.0
