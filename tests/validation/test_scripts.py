"""The scripts of the validation: their statistics on numbers whose answer is known."""

import json
from pathlib import Path

import numpy as np
import pytest
from blind.store import Store
from blind.study import make_study
from budget import MOST, by_fit, least_squares, paired, rises
from calibration import alarms, calibrations, predicted
from ceiling import against_others
from learn_guess import logistic
from pairs import pooled_coverage
from ranks import _LOGNORMAL, BROKEN, DRAWS, Kind, band, drawn, inside, p_of_uniform, passes
from registration import FOLDER, Registration
from simulated_pairs import KINDS
from support.posteriors import build_posterior

import qlvbayes.guess.guess as package
from qlvbayes import read_study
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.guess.features import COMMON, OWN
from qlvbayes.guess.guess import weights
from qlvbayes.inference.errors import whitening
from qlvbayes.inference.modes import find_mode
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.priors import joint
from qlvbayes.simulate import simulate_study, write_csv


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


def test_exact_posteriors_are_calibrated_and_narrow_biased_and_wide_ones_are_not():
    (row,) = calibrations(normal_fits(4000))
    assert abs(row.inside - 0.9) < 4 * row.error
    assert row.error == pytest.approx(np.sqrt(0.9 * 0.1 / 4000), rel=0.1)
    assert abs(row.z_mean) < 4 / np.sqrt(4000)
    assert row.within
    for changes, z_mean, z_sd in (
        ({"stretch": 0.5}, 0.0, 2.0),
        ({"shift": 1.5}, 1.5, 1.0),
        ({"stretch": 2.0}, 0.0, 0.5),
    ):
        (row,) = calibrations(normal_fits(1000, **changes))
        assert not row.within
        assert row.z_mean == pytest.approx(z_mean, abs=0.15)
        assert row.z_sd == pytest.approx(z_sd, rel=0.1)


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


def fits_of(ranks):
    return [{"index": k, "converged": True, "ranks": {"m": int(r)}} for k, r in enumerate(ranks)]


def test_uniform_ranks_pass_and_biased_ones_fail():
    rng = np.random.default_rng(0)
    ps = [p_of_uniform(rng.integers(0, DRAWS + 1, 200)) for _ in range(400)]
    assert 0.02 < np.mean(np.array(ps) < 0.05) < 0.09  # 0.05, with a binomial sd of 0.011
    truth = rng.normal(size=200)
    posterior = rng.normal(size=(200, DRAWS))
    centred = truth[:, None] + 0.0 * posterior + rng.normal(size=(200, 1))
    assert passes(fits_of(np.sum(centred + posterior < truth[:, None], axis=1)))
    assert not passes(fits_of(np.sum(centred + 0.5 * posterior < truth[:, None], axis=1)))
    assert not passes(fits_of(np.sum(centred + 0.7 + posterior < truth[:, None], axis=1)))
    rng = np.random.default_rng(2)
    shared = rng.integers(0, DRAWS + 1, (200, 8))
    biased = np.minimum(shared + 9, DRAWS)  # a third of the ranks' sd of 29

    def fits(ranks):
        names = [f"x{k}" for k in range(ranks.shape[1])]
        return [{"ranks": dict(zip(names, map(int, row), strict=True))} for row in ranks]

    assert passes(fits(shared))
    assert not passes(fits(biased))


def test_the_truth_is_drawn_from_the_priors_and_shares_have_bands():
    rng = np.random.default_rng(1)
    pads = [drawn(rng)[0] for _ in range(2000)]
    for name, values in (("m", [p.m for p in pads]), ("v[2]", [p.v[1] for p in pads])):
        centre, spread = _LOGNORMAL[name]
        assert np.mean(np.log(values)) == pytest.approx(centre, abs=4.0 * spread / 2000**0.5)
        assert np.std(np.log(values)) == pytest.approx(spread, rel=0.07)
    assert all(p.v[0] > p.v[1] for p in pads)
    assert f"m=lognormal({_LOGNORMAL['m'][0]!r},0.4)" in Kind().choices.priors
    assert inside(range(DRAWS + 1), 0.9) == pytest.approx(0.9)
    assert inside(range(DRAWS + 1), 0.5) == pytest.approx(0.5)
    low, high = band(100, 0.9)
    assert 0.8 < low < 0.85
    assert 0.95 < high < 1.0


def test_a_mistake_is_in_the_density_that_is_sampled(monkeypatch, tmp_path):
    for module, name in (
        (joint, "to_simplex"), (joint, "to_between"),
        (whitening, "averaged_correlation"),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, getattr(module, name))  # put back at the end
    truth, noise = drawn(np.random.default_rng(0))
    write_csv(tmp_path / "pad.csv", simulate_study({"pad": truth}, [20.0], noise, 0, 60), ["x"])
    experiment = prepare(read_study(tmp_path / "pad.csv").pad("pad"))

    def density():
        own = build_posterior(experiment, Kind().choices, experiment.with_role("fit"))
        draws = own.space.prior_draws(own.hypothesis)
        constants, prior = own.parameters.bound(np.median(draws, axis=0)[None])
        likelihood = own.likelihood.log_likelihood(own.residuals(constants))
        return [float(prior[0]), float(likelihood[0])]

    found = [density()]
    for mistake in ("jacobian", "noise"):
        BROKEN[mistake]()
        found.append(density())
    changed = np.abs(np.diff(found, axis=0)) > 0.1  # (mistake, prior and likelihood)
    assert changed.tolist() == [[True, False], [False, True]]


def pair(index, rng, width=1.0, differ=None):
    """A pair whose differences have a normal error of sd 1 and intervals of that sd times width."""
    contrasts = {}
    for name in ("m", "b"):
        first, error = 10.0, rng.normal()
        half = 1.6449 * width
        contrasts[name] = {
            "group": "constants", "first": first, "second": first, "low": error - half,
            "high": error + half, "answer": "cannot tell",
        }  # fmt: skip
    found = {"index": index, "kind": KINDS[index % 4], "fit_seconds": 1.0, "compare_seconds": 1.0}
    return found | {
        "converged": [True, True], "differ": differ, "p_value": 0.5, "region": 0.1,
        "contrasts": contrasts,
    }  # fmt: skip


def test_right_intervals_hold_nine_in_ten_and_narrow_ones_fewer():
    rng = np.random.default_rng(0)
    share, error = pooled_coverage([pair(k, rng) for k in range(500)])
    assert abs(share - 0.9) < 4.0 * error
    assert error == pytest.approx(np.sqrt(0.09 / 1000), rel=0.15)
    share, error = pooled_coverage([pair(k, rng, width=0.5) for k in range(500)])
    assert abs(share - 0.589) < 4.0 * error  # erf(0.5 * 1.6449 / sqrt(2))


def test_errors_that_rise_and_falls_over_the_tests():
    assert rises([0.3, 0.2, 0.2, 0.1]) == []
    assert rises([0.1, 0.2, 0.05, 0.06]) == pytest.approx([2.0, 1.2])
    fall, error = paired(np.array([2.0, 12.0, 7.0]), np.array([1.0, 10.0, 4.0]))
    assert fall == pytest.approx(2.0)
    assert error == pytest.approx(1.0 / np.sqrt(3.0))
    assert paired(np.ones(1), np.ones(1)) == (None, None)


@pytest.mark.slow
def test_least_squares_leaves_least_whatever_it_begins_from():
    """From a fit that is far off, the same as from the fit under coarse noise."""
    experiment = prepare(make_study(Registration.read("bounds").population, 283).pad)
    search = build_search(experiment)
    density, plain = search.density, search.baseline
    observed, real = np.asarray(density.space.record.blocks.force), density.space.real

    def rms(point):
        return float(np.sqrt(np.mean((observed - point.predicted)[real] ** 2)))

    fit = find_mode(density.coarse, plain, density.space.prior_draws(plain)[0]).point
    own = density.space.parameters(plain)
    far = density.at(plain, own.within(fit.theta + 0.3 * own.length))
    least = least_squares(density, fit, rms(fit))
    assert least <= rms(fit) < rms(far) / MOST
    assert least_squares(density, far, rms(far)) == pytest.approx(least, rel=0.01)
    found = by_fit(experiment, Choices())
    assert found["ratio"] == found["rms_N"] / found["least_N"] >= 1.0
    assert 0.0 < found["least_N"] < 0.1 * experiment.scales.force


def test_the_weights_are_those_of_the_registered_run():
    registered = json.loads((FOLDER / "guess.json").read_text(encoding="utf-8"))
    assert weights().origin == {key: registered[key] for key in ("run", "seed", "pads")}
    assert len(weights().mean) == len(OWN) + len(COMMON)
    assert Path(package.__file__).with_name("weights.json").stat().st_size < 1e6


def test_the_regression_finds_what_made_the_answers_and_patterns_alike_tell_less():
    rng = np.random.default_rng(0)
    x, true = rng.normal(size=(20000, 2)), np.array([-1.0, 2.0, 0.0])
    there = (rng.random(20000) < 1.0 / (1.0 + np.exp(-true[0] - x @ true[1:]))).astype(float)
    found = logistic(x, there, np.full(2, 3.0))
    assert found == pytest.approx(true, abs=0.1)  # standard errors are 0.02 to 0.03
    design = np.column_stack([np.ones(len(x)), x])
    slope = design.T @ (1.0 / (1.0 + np.exp(-design @ found)) - there)
    assert slope == pytest.approx(-np.array([0.0, 3.0, 3.0]) * found, abs=1e-4)
    apart, alike = np.array([[3.0, 0.0], [0.0, 4.0]]), np.array([[3.0, 0.0], [4.0, 0.0]])
    assert against_others(apart) == pytest.approx([9.0, 16.0])
    assert against_others(alike) == pytest.approx([9.0 / 17.0, 16.0 / 10.0])
