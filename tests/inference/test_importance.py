"""Evidence by importance sampling: against known integrals, and the error that it states."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from qlvbayes.inference.evidence import Evidence
from qlvbayes.inference.importance import BoundedStudentT, sampled_evidence

LOG = -7.3  # of the evidence of the first size; the second's is half of it
COVARIANCE = np.array([[1.0, 0.6, 0.0], [0.6, 2.0, -0.3], [0.0, -0.3, 0.5]])
NOTHING = np.zeros((3, 3))


class Pretended:
    """A density that is normal in three numbers, or in two modes, with a known integral."""

    def __init__(self, centres, lowest=-np.inf):
        self.discrepancy = SimpleNamespace(sizes=np.zeros(2))
        self.lowest = np.array([lowest, -np.inf, -np.inf])
        self.normals = [multivariate_normal(np.array(c), COVARIANCE) for c in centres]

    def log_density(self, own, thetas, tolerance, about, sizes):
        logs = logsumexp([n.logpdf(thetas) for n in self.normals], axis=0)
        logs = logs.reshape(-1) - np.log(len(self.normals)) + LOG
        logs[(thetas < self.lowest).any(axis=1)] = -np.inf
        return np.stack([logs, logs + np.log(0.5)], axis=1)

    def found(self, centres, widened=1.0):
        own = SimpleNamespace(size=3, lowest=self.lowest, highest=np.full(3, np.inf))
        mode = SimpleNamespace(point=SimpleNamespace(own=own))
        return [
            (mode, Evidence(0.0, np.zeros(2), np.array(c), widened * COVARIANCE, NOTHING))
            for c in centres
        ]


TRUTH = LOG + np.log(1.5)


@pytest.mark.parametrize("widened", [0.5, 1.0, 2.0])
@pytest.mark.few(2)
def test_integral_is_met_within_its_error_as_often_as_that_says(widened):
    centre = [(0.3, -1.0, 2.0)]
    density = Pretended(centre)
    pairs = density.found(centre, widened)
    found = [sampled_evidence(density, pairs, 0.0, 0.05, seed) for seed in range(60)]
    z = np.array([(one.log - TRUTH) / one.error for one in found])
    assert all(one.error < 0.15 for one in found)
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.35)
    for one in found[:3]:
        assert np.exp(one.by_size[1] - one.by_size[0]) == pytest.approx(0.5)


def test_two_modes_are_both_counted_and_what_lies_beyond_a_bound_is_not():
    centres = [(-6.0, 0.0, 0.0), (6.0, 0.0, 0.0)]
    density = Pretended(centres)
    one = sampled_evidence(density, density.found(centres), 0.0, 0.05)
    assert one.log == pytest.approx(TRUTH, abs=4.0 * one.error)
    density = Pretended([(0.0, 0.0, 0.0)], lowest=1.0)
    pairs = density.found([(0.0, 0.0, 0.0)])
    one = sampled_evidence(density, pairs, 0.0, 0.05)
    beyond = multivariate_normal(0.0, COVARIANCE[0, 0]).cdf(-1.0)
    assert one.log == pytest.approx(TRUTH + np.log(beyond), abs=4.0 * one.error)


def test_the_error_holds_where_many_numbers_lie_at_a_bound():
    """Amplitudes at zero, whose normals' means are beyond it or inside, and what follows them."""
    means, size = np.array([-3.0, -1.0, 0.0, 1.0]), 12
    rng = np.random.default_rng(2)
    covariance = np.eye(size)
    covariance[4:, :4] = rng.uniform(-0.4, 0.4, (size - 4, 4))
    covariance[:4, 4:] = covariance[4:, :4].T
    covariance[4:, 4:] += covariance[4:, :4] @ covariance[:4, 4:]
    normal = multivariate_normal(np.append(means, np.zeros(size - 4)), covariance)
    lowest = np.append(np.zeros(4), np.full(size - 4, -np.inf))
    own = SimpleNamespace(size=size, lowest=lowest, highest=np.full(size, np.inf))

    def log_density(own, thetas, tolerance, about, sizes):
        inside = (thetas >= lowest).all(axis=1)
        return np.where(inside, normal.logpdf(thetas), -np.inf)[:, None]

    none = SimpleNamespace(sizes=np.zeros(1))
    density = SimpleNamespace(discrepancy=none, log_density=log_density)
    mode = SimpleNamespace(point=SimpleNamespace(own=own))
    pairs = [(mode, Evidence(0.0, np.zeros(1), normal.mean, covariance, 0.0 * covariance))]
    found = [sampled_evidence(density, pairs, 0.0, 0.0, seed) for seed in range(60)]
    truth = norm.logcdf(means).sum()
    z = np.array([(one.log - truth) / one.error for one in found])
    assert max(one.error for one in found) < 0.2
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.35)
    assert abs(np.mean(z)) < 0.5


def test_nothing_is_told_where_the_draws_miss_what_counts():
    density = Pretended([(400.0, 0.0, 0.0)])
    assert sampled_evidence(density, density.found([(0.0, 0.0, 0.0)], 1e-4), 0.0) is None


def test_a_bound_at_a_centre_draws_alike_whichever_side_rounding_puts_it():
    """Else draws, and so answers, would differ between processors."""
    below, above = (
        BoundedStudentT.from_covariance(np.zeros(2), np.eye(2), np.array([low, -np.inf])).draw(
            100, rng
        )
        for low, rng in ((-1e-15, np.random.default_rng(0)), (1e-15, np.random.default_rng(0)))
    )
    assert below == pytest.approx(above, abs=1e-12)
