"""The validation script: its statistics on numbers whose answer is known, and two small fits."""

import json

import numpy as np
import pytest
from blind.store import Store
from calibration import alarms, calibrations, predicted
from coverage import table
from results import Origin
from simulated_fits import Setting, run

from qlvbayes import Settings

PAD = ("m", "b", "c[0]", "c[1]", "c[2]", "v[1]", "v[2]")


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


def test_overconfident_and_biased_posteriors_are_found():
    (narrow,) = calibrations(normal_fits(1000, stretch=0.5))
    assert not narrow.within
    assert narrow.z_sd == pytest.approx(2.0, rel=0.1)
    (biased,) = calibrations(normal_fits(1000, shift=1.5))
    assert not biased.within
    assert biased.z_mean == pytest.approx(1.5, abs=0.15)


def test_too_wide_posteriors_are_found():
    (wide,) = calibrations(normal_fits(1000, stretch=2.0))
    assert wide.inside > 0.95
    assert not wide.within


def test_error_is_not_zero_where_every_interval_held():
    (row,) = calibrations(normal_fits(20, stretch=20.0))
    assert row.inside == 1.0
    assert row.error > 0.0


def test_false_alarms_count_studies_once():
    fits = [{"cells": [cell(fails=True), cell(fails=True)]}, {"cells": [cell(), cell()]}]
    found = alarms(fits)
    assert (found.studies, found.alarmed, found.cells, found.failing) == (2, 1, 4, 2)


def test_predictive_share_weighs_samples_and_leaves_fitted_tests_out():
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


@pytest.fixture(scope="module")
def two_fits():
    settings = Settings(min_steps=100, max_steps=400, stretch=100)
    setting = Setting("white", 300, (20.0,))
    return [run(setting, 3, index, settings) for index in (0, 1)]


@pytest.mark.slow
def test_a_fit_covers_every_constant_once(two_fits):
    for fit in two_fits:
        assert tuple(fit["parameters"]) == PAD
        shares = [fit["parameters"][f"c[{k}]"]["truth"] for k in range(3)]
        assert sum(shares) == pytest.approx(1.0)
        for row in fit["parameters"].values():
            assert row["low"] < row["mean"] < row["high"]
            # a right model and 300 samples: ten sds off would be a wrong name or unit
            assert abs(row["mean"] - row["truth"]) < 10 * row["sd"]


@pytest.mark.slow
def test_fits_survive_the_file_and_make_a_table(two_fits, tmp_path):
    kept = Store(tmp_path / "fits.jsonl")
    for fit in two_fits:
        kept.add(json.loads(json.dumps(fit)))
    results = {Setting("white", 300, (20.0,)): Store(kept.path).first(2)}
    text = table(results, Origin("command", "2026-01-01", "abc1234", "2 cores")).markdown()
    assert all(f"| {name} |" in text for name in PAD)
    assert len({fit["parameters"]["m"]["truth"] for fit in kept.cases.values()}) == 2
