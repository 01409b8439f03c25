"""The likelihood of noise at rest, its averages and its realisations, against dense algebra."""

from dataclasses import replace

import numpy as np
import pytest

from qlvbayes.diagnosis.checks.structure import combined
from qlvbayes.fitting.prediction import realisations
from qlvbayes.inference.errors.whitening import covariance
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.motion.noisefloor.pool import Dwell, Pool
from qlvbayes.motion.record import Blocks


def correlation(lag, tau):
    return np.exp(-np.abs(lag) / tau)


def rest(rng, n=60):
    time = np.cumsum(rng.uniform(0.01, 0.2, n))
    return Dwell(time, rng.standard_normal(n), np.ones(n), np.arange(n))


@pytest.mark.parametrize(("ratio", "tau"), [(1.0, 0.3), (30.0, 0.05), (1e3, 0.8)])
def test_the_banded_likelihood_is_that_of_the_dense_covariance(ratio, tau):
    """With the trends' own directions taken out of data and covariance (Patterson & Thompson)."""
    rng = np.random.default_rng(0)
    dwells = [rest(rng), rest(rng)]
    pool = Pool.from_dwells(dwells, 2.0)
    dense, freedom, power = 0.0, 0, 0.0
    for k, (one, q) in enumerate(zip(dwells, pool.trends, strict=True)):
        lag = one.time[:, None] - one.time
        matrix = np.eye(one.time.size) + ratio * correlation(lag, tau)
        free = np.linalg.svd(q)[0][:, q.shape[1] :]
        inner = free.T @ matrix @ free
        y = free.T @ pool.y[60 * k : 60 * (k + 1)]
        power += y @ np.linalg.solve(inner, y)
        dense -= 0.5 * np.linalg.slogdet(inner)[1]
        freedom += y.size
    dense -= 0.5 * freedom * np.log(power / freedom)
    found, variance = pool.likelihood(np.log(ratio), np.log(tau))
    assert found == pytest.approx(dense, rel=1e-6)
    assert variance == pytest.approx(power / freedom, rel=1e-6)


def samples(time, scale=None):
    one = np.ones(time.size)
    scale = one if scale is None else scale
    return replace(Blocks.of_means(one, one, time, time), scale=scale)


def test_realisations_have_the_covariance_of_the_floor():
    time = np.concatenate([[0.0, 1e-3], np.cumsum(np.full(12, 0.1))])
    given = samples(np.sort(time), np.linspace(1.0, 2.0, time.size))
    floor = NoiseFloor(0.3, 1.0, 0.25)
    drawn = realisations([floor] * 20_000, given, np.random.default_rng(1))
    assert np.allclose(drawn.T @ drawn / 20_000, covariance(floor, given, 0.0), atol=0.2)


@pytest.mark.parametrize("tau", [1e-3, 0.02, 0.4, 1e3])
def test_averages_have_the_covariance_of_their_readings(tau):
    """Few readings far apart, many close together, one alone, and two at nearly one instant."""
    floor = NoiseFloor(0.0, 1.0, tau)
    count = np.array([3.0, 400.0, 1.0, 2.0])
    first = np.array([0.0, 1.5, 2.0, 2.5])
    last = np.array([1.0, 1.9, 2.0, 2.5 + 1e-10])
    times = [np.linspace(a, b, int(n)) for a, b, n in zip(first, last, count, strict=True)]
    mean = np.zeros((4, int(count.sum())))
    for row, begin, n in zip(mean, np.cumsum(count) - count, count, strict=True):
        row[int(begin) : int(begin + n)] = 1.0 / n
    every = np.concatenate(times)
    dense = mean @ correlation(every[:, None] - every, tau) @ mean.T
    blocks = Blocks.of_means(np.ones(4), count, first, last)
    assert np.allclose(covariance(floor, blocks, 0.0), dense, rtol=1e-6, atol=1e-9)


def test_the_combined_p_value_is_uniform_under_chance():
    """Cells are independent; the worst one and all together are nearly independent too."""
    from scipy.stats import chi2

    rng = np.random.default_rng(2)
    cells = rng.chisquare(4, (20_000, 12))
    worst = chi2.sf(cells.max(axis=1), 4)
    joint = chi2.sf(cells.sum(axis=1), 48)
    found = np.array([combined(a, 12, b) for a, b in zip(worst, joint, strict=True)])
    for level in (0.001, 0.01, 0.05, 0.5, 0.95, 0.99):
        slack = 4.0 * np.sqrt(level * (1.0 - level) / found.size)
        assert 0.6 * level - slack < np.mean(found < level) < level + slack + 0.03 * (level > 0.4)
