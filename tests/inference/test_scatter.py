"""Scatter between tests, against dense matrices and draws of random scales."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.scatter import UNDECIDED, Scatter, by_test, likeliest, scaled_parts
from qlvbayes.inference.errors.whitening import Whitener

TESTS, BLOCKS, FREE = 4, 12, 3
PRIOR = UNDECIDED


def made(seed, features=6):
    """A discrepancy of a few features, derivatives of the force, and two parts of the force."""
    rng = np.random.default_rng(seed)
    timing = tuple(rng.uniform(0.0, 1.0, BLOCKS) * (rng.random(BLOCKS) < 0.3) for _ in range(TESTS))
    gap = np.abs(np.subtract.outer(np.arange(BLOCKS), np.arange(BLOCKS)))
    noise = [k * np.exp(-gap / 3.0) + np.diag(0.5 + part) for k, part in enumerate(timing)]
    whitener = Whitener((np.ones(BLOCKS, dtype=bool),) * TESTS, tuple(noise), timing)
    found = Discrepancy.from_features(
        rng.normal(size=(features, TESTS, BLOCKS)), whitener, 10.0, 0.01, scatter=PRIOR
    )
    return found, rng.normal(size=(FREE, TESTS, BLOCKS)), rng.normal(size=(2, TESTS, BLOCKS)), rng


def test_parts_of_the_force_add_up_to_it():
    rng = np.random.default_rng(1)
    predicted, responses = rng.normal(size=(TESTS, BLOCKS)), rng.normal(size=(5, TESTS, BLOCKS))
    parts = scaled_parts(predicted, responses, rng.normal(size=5), [1, 3])
    assert parts.shape == (3, TESTS, BLOCKS)
    np.testing.assert_allclose(parts.sum(axis=0), predicted)
    rows = by_test(parts)
    np.testing.assert_allclose(rows.reshape(3, TESTS, TESTS, BLOCKS).sum(axis=1), parts)
    assert np.count_nonzero(np.any(rows != 0.0, axis=2), axis=1).tolist() == [1] * 3 * TESTS


@pytest.mark.parametrize(
    ("size", "scatter"), [(0.0, (0.2, 0.0)), (0.3, (0.1, 0.3)), (2.0, (0.0, 0.0))]
)
def test_the_covariance_is_that_of_dense_matrices(size, scatter):
    """Against D + (1 - P)(s^2 K + V S V + T)(1 - P) + P T P, with all matrices written out."""
    found, responses, parts, rng = made(3)
    cost = 1.7
    separation = found.separated(responses, np.ones(FREE), lambda: parts, Scatter(scatter, cost))
    flat = found.whitener.flattened
    noise = found.whitener.covariance
    slopes, features, rows = flat(responses), flat(found.features), flat(by_test(parts))
    project = np.eye(noise.shape[0]) - slopes.T @ np.linalg.solve(slopes @ slopes.T, slopes)
    spread = rows.T @ np.diag(np.repeat(np.square(scatter), TESTS)) @ rows
    smooth = size**2 * features.T @ features
    dense = noise + project @ (smooth + spread) @ project
    dense += found.rough * size**2 * np.eye(len(noise))
    if size > 0.0:
        timing, along = np.diag(np.concatenate(found.whitener.timing)), np.eye(len(noise)) - project
        dense += project @ timing @ project + along @ timing @ along - timing
    np.testing.assert_allclose(noise + separation.covariance(size, found.rough), dense, atol=1e-10)
    vectors = rng.normal(size=(3, len(noise)))
    sized = found.at(size, separation)
    whitened = found.whitener.whiten(vectors)
    expected = vectors @ np.linalg.solve(dense, vectors.T)
    np.testing.assert_allclose(sized.products(whitened), expected, rtol=1e-8)
    np.testing.assert_allclose(sized.squares(whitened), np.diag(expected), rtol=1e-8)
    volume = np.linalg.slogdet(dense)[1] - np.linalg.slogdet(noise)[1]
    assert sized.log_volume == pytest.approx(volume + 2.0 * cost)


def test_the_likeliest_scatter_lowers_the_loss_by_what_is_said():
    found, responses, parts, rng = made(5)
    separation = found.separated(responses, np.ones(FREE), lambda: parts)
    flat = found.whitener.flattened
    scales = np.repeat([0.0, 3.0], TESTS) * rng.normal(size=2 * TESTS)
    left = flat(by_test(parts)).T @ scales + rng.normal(size=TESTS * BLOCKS)
    residual = found.whitener.whiten(left[None])[0]
    size, scatter = found.likeliest(residual, 0.0, separation)
    here = list(found.sizes).index(size)
    losses = {
        sizes: -found.log_likelihoods(residual[None], separation.with_scatter(s))[0, here]
        for sizes in [(0.0, 0.0), scatter.sizes, (0.5, 0.0)]
        for s in [scatter if sizes == scatter.sizes else Scatter(sizes)]
    }
    assert scatter.sizes[1] == PRIOR.largest
    assert min(losses, key=losses.get) == scatter.sizes


@given(seed=st.integers(0, 1000), true=st.sampled_from([0.0, 0.3]))
def test_scales_that_do_not_differ_have_no_scatter(seed, true):
    """Where each of 40 tests knows its scale to 2 %, a scatter of 30 % is seen and none is not."""
    rng = np.random.default_rng(seed)
    curvature = np.eye(40) / 0.02**2
    slope = curvature @ (true * rng.normal(size=40)) + rng.normal(size=40) / 0.02
    loss, found = likeliest(curvature, slope, np.zeros(40, dtype=np.intp), PRIOR)
    assert loss <= 0.0
    if true == 0.0:
        assert found.sizes[0] <= 0.02
    else:
        assert 0.15 < found.sizes[0] <= 0.5


def test_a_single_test_has_no_scatter():
    found, responses, _, rng = made(7)
    alone = found.separated(responses, np.ones(FREE))
    size, scatter = found.likeliest(rng.normal(size=TESTS * BLOCKS), 0.0, alone)
    assert not any(scatter.sizes)
    assert size in found.sizes
