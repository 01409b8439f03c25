"""Are a fit's intervals honest, and is its curve as good as the best that its model can draw?"""

from pathlib import Path

import numpy as np
import pytest
from quoted import QUICK, both_errors
from scipy.stats import binom
from simulated_fits import Setting, run
from support.endtoend import CONSTANTS

from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare

ROOT = Path(__file__).parents[2]

REAL = ROOT.parent / "shared" / "real" / "muscle_ramps.csv"


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


@pytest.mark.slow
def test_intervals_hold_the_truth_nine_times_in_ten():
    """Right models of one test: by each constant, and by all; chance of failing 1 % in all."""
    count = 20
    fits = [run(Setting("correlated", 300, (20.0,)), 5, k, QUICK) for k in range(count)]
    rows = {name: [fit["parameters"][name] for fit in fits] for name in CONSTANTS}
    held = {name: sum(r["low"] <= r["truth"] <= r["high"] for r in rows[name]) for name in rows}
    least = binom.ppf(0.01 / len(CONSTANTS), count, 0.9)
    assert min(held.values()) >= least, held
    # constants of one pad miss together: as if a pad had two of its own
    assert sum(held.values()) / len(CONSTANTS) >= binom.ppf(0.01, 2 * count, 0.9) / 2, held
