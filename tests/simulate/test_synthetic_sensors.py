"""Encoder steps and load-cell noise have the statistics they state."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qlvbayes.io.checks import InputError
from qlvbayes.simulate import NOISES, TABLE_1, Noise, encode, paper_protocol, simulate_test

TIMES = np.array([0.0, 0.001, 0.1, 0.5, 1.5, 6.0])
# Every bound is 5 standard errors: a false alarm in about 1 of 10^6 comparisons.
Z = 5.0


@pytest.mark.parametrize("kind", ["correlated", "white"])
def test_noise_has_the_stated_covariance_at_uneven_times(kind):
    noise = NOISES[kind]
    rng = np.random.default_rng(11)
    draws = np.array([noise.draw(TIMES, rng) for _ in range(20_000)])
    lags = np.abs(TIMES[:, None] - TIMES)
    expected = noise.correlated**2 * np.exp(-lags / noise.correlation_time)
    expected += noise.white**2 * np.eye(TIMES.size)
    spread = np.diag(expected)
    error = np.sqrt((np.outer(spread, spread) + expected**2) / len(draws))
    assert np.all(np.abs(draws.T @ draws / len(draws) - expected) < Z * error)
    assert np.all(np.abs(draws.mean(axis=0)) < Z * np.sqrt(spread / len(draws)))


def test_both_kinds_have_a_total_of_0_01_newton():
    for kind in ("correlated", "white"):
        assert np.hypot(NOISES[kind].white, NOISES[kind].correlated) == pytest.approx(0.01)


def test_neighbouring_samples_of_a_test_differ_by_the_white_noise_alone():
    record = simulate_test(
        TABLE_1["B"], paper_protocol(20.0), NOISES["correlated"], np.random.default_rng(5)
    )
    steps = np.diff(record.force - record.true_force)
    expected = 2 * 0.006**2 + 2 * 0.008**2 * -np.expm1(-0.001 / 0.5)
    # Differences of white noise correlate by -1/2 with their neighbours: variance 3 / n.
    assert abs(np.mean(steps**2) / expected - 1) < Z * np.sqrt(3 / steps.size)


def test_no_noise_leaves_the_true_force():
    record = simulate_test(
        TABLE_1["B"], paper_protocol(20.0), NOISES["none"], np.random.default_rng(5)
    )
    assert np.array_equal(record.force, record.true_force)


@given(st.lists(st.floats(-2.0, 2.0), min_size=1), st.sampled_from([0.001, 0.01]))
def test_the_encoder_is_at_most_half_a_step_off(displacement, step):
    true = np.array(displacement)
    read = encode(true, step)
    assert np.all(np.abs(read - true) <= 0.5 * step * (1 + 1e-9))
    assert np.allclose(read / step, np.round(read / step), atol=1e-9)


@pytest.mark.parametrize("values", [(-1.0, 0.0, 1.0), (0.0, -1.0, 1.0), (0.0, 0.0, 0.0)])
def test_impossible_noise_is_refused(values):
    with pytest.raises(InputError):
        Noise(*values)
