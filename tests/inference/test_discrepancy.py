"""A discrepancy: the smooth functions of which it is made, and what it says is left."""

import numpy as np
import pytest
from blind.catalogue import OUTSIDE
from hypothesis import given
from hypothesis import strategies as st
from support.hidden_pads import hidden_pad

from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.summary.diagnosis import DiagnosisWork, discrepancy
from qlvbayes.inference.errors.features import DiscrepancyPrior, Features, Locations, covariance

SHARE = 1e-3  # of the variance, that features may leave out


def places(rng, count):
    smooth = np.stack(
        [
            rng.uniform(-7.0, 3.0, count),
            rng.uniform(0.0, 1.0, count),
            rng.uniform(-2.0, 4.0, count),
        ],
        axis=1,
    )
    return Locations(
        smooth, rng.uniform(0.5, 1.0, count), rng.integers(0, 3, count), rng.integers(0, 4, count)
    )


@given(st.integers(0, 1000))
def test_the_kernel_is_a_covariance(seed):
    matrix = covariance(*2 * (places(np.random.default_rng(seed), 40),))
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -1e-10
    assert matrix.max() <= 1.0 + 1e-12


def test_features_and_correlations_are_those_of_the_prior():
    some = places(np.random.default_rng(0), 120)
    features = Features.from_locations(some)
    left = covariance(some, some) - features(some).T @ features(some)
    assert np.max(np.diag(left)) <= SHARE
    assert np.linalg.eigvalsh(left).min() > -1e-9  # what is left out is a covariance too
    rng = np.random.default_rng(1)
    one = places(rng, 1)
    other_test = Locations(one.smooth, one.size, one.phase, one.test + 1)
    other_phase = Locations(one.smooth, one.size, one.phase + 1, one.test)
    own = covariance(one, one)[0, 0]
    assert covariance(one, other_test)[0, 0] == pytest.approx(0.5 * own)  # the shared half
    assert covariance(one, other_phase)[0, 0] == 0.0
    prior = DiscrepancyPrior(time=1.5, depth=0.4, rate=0.7, unloaded=0.25)
    smooth = prior.smooth(np.array([0.1, 0.3]), np.array([0.2, 0.9]), np.array([2.0, 5.0]))
    some = Locations(smooth, prior.size(np.array([0.0, -1.2])), np.zeros(2), np.zeros(2))
    far = np.sqrt(3.0) * np.abs([np.log(3.0) / 1.5, 0.7 / 0.4, np.log(2.5) / 0.7])
    time, depth, rate = (1.0 + far) * np.exp(-far)
    expected = 0.25 * 1.0 * time * depth * (0.5 * rate + 0.5)
    assert covariance(some, some)[0, 1] == pytest.approx(expected)


def test_where_nothing_is_left_there_is_no_discrepancy():
    work, residuals = left_by_the_plain_model(hidden_pad(rates=(1.0, 20.0)))
    assert work.selected.mode.size == 0.0
    for band, residual in zip(discrepancy(work), residuals, strict=True):
        assert band.mean.shape == band.sd.shape == residual.shape
        assert not band.mean.any()
        assert not band.sd.any()


def left_by_the_plain_model(experiment):
    """The plain model alone at its mode, and what it leaves of every sample (N)."""
    search = build_search(experiment, kinds=())
    search.evaluate(search.baseline)
    candidate = search.modes[search.baseline][0]
    samples = Samples.from_experiment(experiment, search.density.space)
    residuals = samples.residuals(search.density, candidate.mode)
    return DiagnosisWork(experiment, search, samples, (candidate,), ()), residuals


def chi_square(work, errors):
    """Return chi^2 of errors at all samples (N) by the noise's covariance: about 1 for noise."""
    floor, total = work.experiment.floor, 0.0
    for trial, rows, error in zip(work.samples.trials, work.samples.rows, errors, strict=True):
        apart = np.abs(np.subtract.outer(trial.test.time[rows], trial.test.time[rows]))
        noise = floor.ou**2 * np.exp(-apart / floor.tau) + floor.white**2 * np.eye(error.size)
        total += error @ np.linalg.solve(noise, error)
    return total / sum(error.size for error in errors)


def test_what_is_left_is_the_discrepancy_and_noise():
    """A shift of one test's forces, in noise whose own memory could pass for a part of it."""
    shift = OUTSIDE["slow_creep_jump"](offset=-0.06, begin=100.0, time=15.0)
    work, residuals = left_by_the_plain_model(hidden_pad(shift, rates=(1.0, 5.0, 10.0, 20.0)))
    bands = discrepancy(work)
    rest = [r - band.mean for r, band in zip(residuals, bands, strict=True)]
    assert chi_square(work, residuals) > 1.5
    assert chi_square(work, rest) == pytest.approx(1.0, abs=0.2)
    sds = np.concatenate([band.sd for band in bands])
    assert np.all((sds > 0.0) & (sds < work.selected.mode.size))  # surer than without the tests
