"""Fitted motions stay with their readings, and phases are those that an experimenter would name."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from qlvbayes.preprocess.phases import find_phases
from qlvbayes.preprocess.polyline import corners
from qlvbayes.preprocess.segments import dither, tolerance
from qlvbayes.preprocess.trajectory import smooth

RECORD = Path(__file__).parents[2] / "shared" / "records" / "scatter_quarter_step.csv"
STEP = 1e-3


def press(t):
    return np.interp(t, [0.0, 0.5, 1.5, 2.0], [0.0, 0.0, 2.0, 2.0])


def kinds(fit):
    return [phase.kind for phase in find_phases(fit)]


@pytest.mark.parametrize("share", [0.05, 0.1, 0.25, 0.5, 1.0, 3.0])
def test_a_press_read_by_an_encoder_that_dithers(share):
    rng = np.random.default_rng(1)
    t = 0.02 * np.arange(2000)
    x = STEP * np.round((press(t) + share * STEP * rng.normal(size=t.size)) / STEP)
    fit = smooth(t, x)
    every = np.linspace(0.0, t[-1], 50_001)
    assert np.abs(fit.displacement(every) - press(every)).max() < 2.0 * STEP * max(1.0, share)
    assert fit.knots.size == 4
    assert kinds(fit) == ["hold", "ramp", "hold"]
    assert fit.departure is None


def test_the_record_with_scatter_of_a_quarter_step():
    if not RECORD.exists():
        pytest.skip("scatter_quarter_step.csv is not here")
    read = pd.read_csv(RECORD)
    fit = smooth(read["time_s"].to_numpy(), read["displacement_mm"].to_numpy())
    assert np.abs(fit.displacement(np.linspace(0.0, 41.18, 50_001))).max() < 2.002
    assert fit.knots.size == 4
    assert kinds(fit) == ["hold", "ramp", "hold"]


def test_rounding_alone_is_no_dither():
    t = np.arange(0.0, 10.0, 1e-3)
    for x in (0.1 * t, np.sin(t), press(t)):
        assert dither(STEP * np.round(x / STEP), STEP) == 0.0


def test_noise_beside_an_encoders_steps_is_at_least_the_scatter():
    rng = np.random.default_rng(3)
    for share in (0.25, 0.5, 1.0):
        x = np.round(0.3 + share * rng.normal(size=5000))
        noise = tolerance(np.arange(5000.0), x, 1.0).noise
        assert share * 0.9 < noise < share * 2.0


def test_lines_are_within_the_tolerance_of_every_reading():
    rng = np.random.default_rng(2)
    t, x = np.sort(rng.uniform(0.0, 1.0, 300)), np.cumsum(rng.normal(size=300))
    kept = corners(t, x, 1.5)
    assert np.abs(np.interp(t, t[kept], x[kept]) - x).max() <= 1.5
    assert kept.size < t.size


def test_a_platen_that_overshoots_and_settles_holds_from_its_farthest_point():
    t = np.arange(0.0, 5.0, 1e-3)
    s = np.maximum(t - 0.7, 0.0)
    ring = 0.06 * np.exp(-s / 0.03) * np.cos(s / 0.02)
    x = np.where(t < 0.7, 2.06 * np.clip((t - 0.5) / 0.2, 0.0, 1.0), 2.0 + ring)
    fit = smooth(t, STEP * np.round(x / STEP))
    assert kinds(fit) == ["hold", "ramp", "hold"]
    assert fit.displacement(0.7) == pytest.approx(2.06, abs=0.01)  # the motion keeps it


def test_a_small_retraction_after_a_hold_is_an_unload():
    t = np.arange(0.0, 12.0, 1e-2)
    x = np.interp(t, [0.0, 1.0, 5.0, 5.2, 12.0], [0.0, 2.0, 2.0, 1.9, 1.9])
    assert kinds(smooth(t, x)) == ["ramp", "hold", "unload", "recovery"]


def test_one_reading_at_rest_is_no_phase():
    t = np.arange(0.0, 4.0, 0.1)
    x = np.interp(t, [0.0, 0.1, 2.0, 3.8, 4.0], [0.0, 0.0, 2.0, 2.0, 2.0])
    fit = smooth(t, x)
    for phase in find_phases(fit):
        assert np.count_nonzero((t >= phase.start - 1e-9) & (t <= phase.stop + 1e-9)) > 1
