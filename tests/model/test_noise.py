"""Noise models against the dense multivariate normal of the samples that blocks average."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from qlvbayes.model.noise import Correlated, White
from qlvbayes.motion.record import Blocks

log_likelihoods = jax.jit(lambda noise, residual, blocks: noise.log_likelihoods(residual, blocks))
likelihood_slopes = jax.jit(
    jax.grad(lambda noise, r, blocks: jnp.sum(noise.log_likelihoods(r, blocks)), argnums=(0, 1))
)
draw = jax.jit(jax.vmap(lambda noise, key, blocks: noise.draw(key, blocks), (None, 0, None)))
BLOCKS = 30


def some_blocks(rng, spacing=1.0, most=12, weighted=False):
    """Blocks of evenly spaced samples, uneven gaps between; also each block's sample times."""
    count = rng.integers(1, most + 1, BLOCKS)
    step = spacing * rng.uniform(0.5, 2.0, BLOCKS)
    gap = spacing * rng.exponential(3.0, BLOCKS)
    length = step * (count - 1)
    first = np.cumsum(gap + np.concatenate([[0.0], length[:-1]]))
    times = [a + h * np.arange(n) for a, h, n in zip(first, step, count, strict=True)]
    weight = rng.uniform(0.5, 2.0, BLOCKS) if weighted else np.ones(BLOCKS)
    fields = (np.zeros(BLOCKS), count.astype(float), first, first + length, weight)
    return jax.tree.map(jnp.asarray, Blocks.of_means(*fields)), times


def covariance(noise, blocks, times):
    """Average the covariance of the single samples over every pair of blocks.

    Measured sds weigh the white part only.
    """
    every = np.concatenate(times)
    owner = np.repeat(np.arange(len(times)), [t.size for t in times])
    mean = (owner == np.arange(len(times))[:, None]) / np.array([[t.size] for t in times])
    apart = np.abs(every[:, None] - every)
    white = (noise.white * np.asarray(blocks.weight)[owner]) ** 2
    samples = noise.ou**2 * np.exp(-apart / noise.tau) + np.diag(white)
    return mean @ samples @ mean.T


def dense_log_density(residual, matrix):
    root = np.linalg.cholesky(matrix)
    white = np.linalg.solve(root, residual)
    return (
        -0.5 * white @ white - np.sum(np.log(np.diag(root))) - 0.5 * white.size * np.log(2 * np.pi)
    )


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("most", [1, 2, 12])
@pytest.mark.parametrize("tau", [1e-3, 0.3, 3.0, 100.0, 1e5])
def test_correlated_is_the_dense_normal_of_the_averages(tau, most, weighted):
    """Spacing about 1 s: from no correlation between neighbours to one that outlasts the record."""
    rng = np.random.default_rng([most, int(weighted), int(1e3 * tau)])
    for _ in range(10):
        blocks, times = some_blocks(rng, most=most, weighted=weighted)
        white, ou = np.exp(rng.uniform(np.log(0.1), np.log(10.0), 2))
        noise = Correlated(white, ou, tau * rng.uniform(0.5, 2.0))
        matrix = covariance(noise, blocks, times)
        residual = np.linalg.cholesky(matrix) @ rng.standard_normal(BLOCKS)
        found = float(np.sum(log_likelihoods(noise, jnp.asarray(residual), blocks)))
        expected = dense_log_density(residual, matrix)
        assert abs(found - expected) < 1e-8 * max(abs(expected), BLOCKS)


def test_each_term_is_conditional_on_the_blocks_before_it():
    rng = np.random.default_rng(4)
    blocks, times = some_blocks(rng)
    noise = Correlated(0.5, 1.0, 4.0)
    residual = rng.standard_normal(BLOCKS)
    matrix = covariance(noise, blocks, times)
    heads = [0.0]
    heads += [dense_log_density(residual[:k], matrix[:k, :k]) for k in range(1, BLOCKS + 1)]
    assert np.allclose(log_likelihoods(noise, residual, blocks), np.diff(heads), atol=1e-9)


def test_a_sampled_millisecond_of_a_slow_drift_keeps_its_precision():
    """1 kHz with a correlation time of 1000 s: the closed forms cancel to one part in 1e6."""
    rng = np.random.default_rng(5)
    for _ in range(10):
        blocks, times = some_blocks(rng, spacing=1e-3)
        noise = Correlated(0.01, 0.01, 1e3)
        matrix = covariance(noise, blocks, times)
        residual = np.linalg.cholesky(matrix) @ rng.standard_normal(BLOCKS)
        found = float(np.sum(log_likelihoods(noise, residual, blocks)))
        expected = dense_log_density(residual, matrix)
        assert abs(found - expected) < 1e-8 * max(abs(expected), BLOCKS)


def test_blocks_of_one_are_the_samples_themselves():
    rng = np.random.default_rng(6)
    time = np.cumsum(rng.exponential(1.0, BLOCKS))
    residual = rng.standard_normal(BLOCKS)
    blocks = Blocks.from_samples(time, residual, np.ones(BLOCKS))
    noise = Correlated(0.3, 0.9, 2.0)
    matrix = covariance(noise, blocks, [np.array([t]) for t in time])
    found = np.sum(log_likelihoods(noise, residual, blocks))
    assert np.isclose(found, dense_log_density(residual, matrix), rtol=1e-10)


NOISES = [White(0.4), Correlated(0.3, 0.5, 2.0)]


def padded(blocks, more):
    """Masked blocks at the end, as batching adds them."""
    full = jax.tree.map(lambda x: jnp.pad(x, (0, more), mode="edge"), blocks)
    real = jnp.arange(BLOCKS + more) < BLOCKS
    return replace(full, count=jnp.where(real, full.count, 1.0), real=real)


@pytest.mark.parametrize("noise", NOISES, ids=repr)
def test_padding_adds_nothing_to_value_or_slopes(noise):
    rng = np.random.default_rng(8)
    blocks, _ = some_blocks(rng, weighted=True)
    residual = jnp.asarray(rng.standard_normal(BLOCKS))
    longer = jnp.concatenate([residual, jnp.full(7, 1e3)])
    short = log_likelihoods(noise, residual, blocks)
    long = log_likelihoods(noise, longer, padded(blocks, 7))
    assert np.all(long[BLOCKS:] == 0.0)
    assert np.allclose(long[:BLOCKS], short, rtol=1e-13)
    with_padding = likelihood_slopes(noise, longer, padded(blocks, 7))
    without = likelihood_slopes(noise, residual, blocks)
    for a, b in zip(jax.tree.leaves(with_padding[0]), jax.tree.leaves(without[0]), strict=True):
        assert np.isclose(a, b, rtol=1e-10)
    assert np.all(with_padding[1][BLOCKS:] == 0.0)


@pytest.mark.parametrize("tau", [1e-6, 1e-2, 1.0, 1e3])
def test_slopes_of_the_correlated_likelihood_are_finite_differences(tau):
    rng = np.random.default_rng(9)
    blocks, _ = some_blocks(rng)
    residual = jnp.asarray(rng.standard_normal(BLOCKS))

    @jax.jit
    def total(logs):
        return jnp.sum(Correlated(*jnp.exp(logs)).log_likelihoods(residual, blocks))

    at, size = jnp.log(jnp.array([0.5, 0.8, tau])), 1e-5
    slope = jax.grad(total)(at)
    for k in range(3):
        ends = [total(at.at[k].add(sign * size)) for sign in (1.0, -1.0)]
        difference = (ends[0] - ends[1]) / (2.0 * size)
        assert np.isclose(slope[k], difference, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("tau", [1e-12, 1e12])
def test_slopes_stay_finite_at_correlation_times_out_of_reach(tau):
    rng = np.random.default_rng(9)
    blocks, _ = some_blocks(rng)
    residual = jnp.asarray(rng.standard_normal(BLOCKS))
    slopes = likelihood_slopes(Correlated(0.5, 0.8, tau), residual, blocks)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))


def test_no_correlated_part_is_white_noise():
    rng = np.random.default_rng(10)
    blocks, _ = some_blocks(rng, weighted=True)
    residual = rng.standard_normal(BLOCKS)
    white = log_likelihoods(White(0.4), residual, blocks)
    assert np.allclose(log_likelihoods(Correlated(0.4, 0.0, 2.0), residual, blocks), white)


def test_white_is_the_normal_of_the_means():
    rng = np.random.default_rng(11)
    blocks, _ = some_blocks(rng, weighted=True)
    residual = rng.standard_normal(BLOCKS)
    scale = 0.4 * np.asarray(blocks.weight) / np.sqrt(blocks.count)
    expected = stats.norm.logpdf(residual, 0.0, scale)
    assert np.allclose(log_likelihoods(White(0.4), residual, blocks), expected, rtol=1e-12)


def test_sample_sd_is_that_of_a_single_sample():
    samples = Blocks.from_samples(np.arange(2.0), np.zeros(2), np.array([1.0, 2.0]))
    assert np.allclose(White(0.4).sample_sd(samples), [0.4, 0.8])
    assert np.allclose(Correlated(0.3, 0.4, 1.0).sample_sd(samples), np.hypot([0.3, 0.6], 0.4))


DRAWS = 20_000


@pytest.mark.parametrize("tau", [0.05, 4.0, 1e4])
def test_draws_have_the_covariance_of_the_averages(tau):
    """All 465 entries within 5.5 standard errors: a false alarm once in fifty thousand runs."""
    blocks, times = some_blocks(np.random.default_rng(13), most=6, weighted=True)
    noise = Correlated(0.6, 0.8, tau)
    keys = jax.random.split(jax.random.key(1), DRAWS)
    draws = np.asarray(draw(noise, keys, blocks))
    expected = covariance(noise, blocks, times)
    sd = np.sqrt(np.diag(expected))
    assert np.all(np.abs(draws.mean(axis=0)) < 5.5 * sd / np.sqrt(DRAWS))
    found = draws.T @ draws / DRAWS
    error = np.sqrt((expected**2 + np.outer(sd**2, sd**2)) / DRAWS)
    assert np.max(np.abs(found - expected) / error) < 5.5


def test_independent_draws_have_the_distribution_of_the_likelihood():
    blocks, _ = some_blocks(np.random.default_rng(14), weighted=True)
    keys = jax.random.split(jax.random.key(2), 500)
    draws = np.asarray(draw(White(0.4), keys, blocks))
    scaled = (draws / blocks.weight * np.sqrt(blocks.count)).ravel()
    # a false alarm once in a hundred thousand
    assert stats.kstest(scaled, stats.norm(0.0, 0.4).cdf).pvalue > 1e-5
