"""Errors over all samples, where some are less good than others."""

import numpy as np
import pytest

from qlvbayes.diagnosis.checks.heldout import HeldOut
from qlvbayes.diagnosis.checks.samples import rmse


def test_without_sds_an_error_is_the_plain_root_mean_square():
    residuals = [np.array([3.0, -4.0]), np.array([0.0])]
    assert rmse(residuals) == pytest.approx(np.sqrt(25.0 / 3.0))
    equal = [np.full(2, 0.7), np.full(1, 0.7)]
    assert rmse(residuals, equal) == pytest.approx(rmse(residuals))


def test_a_sample_of_ten_times_the_sd_counts_a_hundredth():
    good, bad = 0.1, 50.0
    expected = np.sqrt((good**2 + bad**2 / 100.0) / 1.01)
    assert rmse([np.array([good, bad])], [np.array([1.0, 10.0])]) == pytest.approx(expected)


def test_weighted_least_squares_has_the_least_error():
    """The inverse-variance mean of a constant force is best, so its error is the least."""
    rng = np.random.default_rng(0)
    sds = np.geomspace(0.1, 3.0, 50)
    force = 2.0 + sds * rng.standard_normal(50)
    mean = np.average(force, weights=sds**-2.0)
    errors = [rmse([force - other], [sds]) for other in (mean - 0.01, mean, mean + 0.01)]
    assert errors[1] == min(errors)
    assert rmse([force - force.mean()], [sds]) > errors[1]


def test_errors_of_parts_left_out_are_weighted_within_each():
    residuals, sds = [np.array([1.0, 9.0]), np.array([2.0])], [np.array([1.0, 1e6]), np.ones(1)]
    left_out = HeldOut.from_residuals(residuals, sds)
    assert left_out.by_part == pytest.approx((1.0, 2.0))
    assert left_out.rmse == pytest.approx(np.sqrt(2.5))
