"""The validation script: its statistics on numbers whose answer is known, and two small fits."""

import numpy as np
import pytest
from blind.store import Store
from calibration import alarms, calibrations, predicted


def normal_fits(n, stretch=1.0, shift=0.0, seed=0):
    """Fits whose posterior sds are ``stretch`` times too large and whose means are off by shift."""
    rng = np.random.default_rng(seed)
    fits = []
    for index in range(n):
        truth, error = rng.uniform(1.0, 2.0), rng.normal()
        mean, sd = truth + 0.01 * (error + shift), 0.01 * stretch
        low, high = mean - 1.6449 * sd, mean + 1.6449 * sd
        row = {"truth": truth, "mean": mean, "sd": sd, "low": low, "high": high, "below": 0.5}
        fit = {"index": index, "parameters": {"m": row}, "cells": []}
        fits.append(fit | {"converged": True, "steps": 1000, "seconds": 1.0})
    return fits


def cell(role="validate", phase="hold", n=10, coverage90=0.9, fails=False):
    return {"role": role, "phase": phase, "n": n, "coverage90": coverage90, "fails": fails}


def test_exact_posteriors_are_called_calibrated():
    (row,) = calibrations(normal_fits(4000))
    assert abs(row.inside - 0.9) < 4 * row.error
    assert row.error == pytest.approx(np.sqrt(0.9 * 0.1 / 4000), rel=0.1)
    assert abs(row.z_mean) < 4 / np.sqrt(4000)
    assert abs(row.z_sd - 1.0) < 4 / np.sqrt(8000)
    assert row.within


def test_overconfident_biased_and_too_wide_posteriors_are_found():
    (narrow,) = calibrations(normal_fits(1000, stretch=0.5))
    assert not narrow.within
    assert narrow.z_sd == pytest.approx(2.0, rel=0.1)
    (biased,) = calibrations(normal_fits(1000, shift=1.5))
    assert not biased.within
    assert biased.z_mean == pytest.approx(1.5, abs=0.15)
    (wide,) = calibrations(normal_fits(1000, stretch=2.0))
    assert wide.inside > 0.95
    assert not wide.within
    (row,) = calibrations(normal_fits(20, stretch=20.0))
    assert row.inside == 1.0
    assert row.error > 0.0


def test_alarms_and_shares_are_counted_over_studies_and_samples():
    fits = [{"cells": [cell(fails=True), cell(fails=True)]}, {"cells": [cell(), cell()]}]
    found = alarms(fits)
    assert (found.studies, found.alarmed, found.cells, found.failing) == (2, 1, 4, 2)
    fits = [
        {"cells": [cell(n=30, coverage90=1.0), cell(n=10, coverage90=0.6)]},
        {"cells": [cell(n=10, coverage90=0.9), cell(role="fit", coverage90=0.0)]},
    ]
    assert predicted(fits, "hold")[0] == pytest.approx(0.9)
    assert predicted(fits, "ramp") is None


def test_a_line_cut_short_is_fitted_again(tmp_path):
    kept = Store(tmp_path / "fits.jsonl")
    for fit in normal_fits(3):
        kept.add(fit)
    text = kept.path.read_text()
    kept.path.write_text(text[:-20])
    again = Store(kept.path)
    assert sorted(again.cases) == [0, 1]
    again.add(normal_fits(3)[2])
    assert kept.path.read_text() == text
