"""Nested sampling and importance sampling against evidences that are known."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.stats as jss
import numpy as np
import pytest
from scipy.stats import kstest, multivariate_normal
from support.endtoend import experiment

from qlvbayes.diagnosis.diagnose import nested_audit
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.fitting.fit import build_posterior
from qlvbayes.inference.nested_sampling import nested_evidence
from qlvbayes.model.choices import Choices
from qlvbayes.model.posterior import draw_priors
from qlvbayes.priors import Normal


class Straight(eqx.Module):
    """y = A x + noise of unit sd, x standard normal: the evidence is a normal density of y."""

    model: list
    noise: list
    slopes: jax.Array
    observed: jax.Array

    @property
    def size(self):
        return self.slopes.shape[1]

    def log_priors(self, theta):
        return jss.norm.logpdf(theta)

    def log_likelihood(self, theta):
        return jnp.sum(jss.norm.logpdf(self.observed - self.slopes @ theta))

    @property
    def exact(self):
        A = np.asarray(self.slopes)
        covariance = np.eye(len(A)) + A @ A.T
        return multivariate_normal(cov=covariance).logpdf(np.asarray(self.observed))

    @property
    def moments(self):
        A = np.asarray(self.slopes)
        covariance = np.linalg.inv(np.eye(self.size) + A.T @ A)
        return covariance @ A.T @ np.asarray(self.observed), np.sqrt(np.diag(covariance))


@pytest.fixture(scope="module")
def straight():
    rng = np.random.default_rng(4)
    slopes = rng.normal(size=(8, 3)) * [10.0, 3.0, 0.5]
    priors = [Normal(0.0, 1.0)] * 3
    return Straight(priors, [], jnp.asarray(slopes), jnp.asarray(slopes @ [0.5, -1.0, 0.3]))


@pytest.mark.slow
def test_the_evidence_of_a_straight_line_is_exact(straight):
    runs = [nested_evidence(straight, seed, live=60) for seed in range(4)]
    found = np.array([run.log_evidence for run in runs])
    errors = np.array([run.error for run in runs])
    assert np.all(np.abs(found - straight.exact) < 3.5 * errors)
    assert abs(found.mean() - straight.exact) < 3.0 * np.sqrt(np.mean(errors**2) / 4.0)
    assert np.all((errors > 0.1) & (errors < 0.8))


@pytest.mark.slow
def test_draws_are_of_the_posterior(straight):
    runs = [nested_evidence(straight, seed, live=60, draws=500) for seed in range(4)]
    mean, sd = straight.moments
    together = np.concatenate([run.draws for run in runs])
    assert together.shape == (2000, 3)
    assert np.all(np.abs(together.mean(axis=0) - mean) < 0.4 * sd)
    np.testing.assert_allclose(together.std(axis=0), sd, rtol=0.3)


@pytest.mark.slow
def test_a_seed_repeats(straight):
    one, two = (nested_evidence(straight, 7, live=60) for _ in range(2))
    assert one.log_evidence == two.log_evidence
    assert one.evaluations == two.evaluations > 60
    np.testing.assert_array_equal(one.draws, two.draws)
    assert nested_evidence(straight, 8, live=60).log_evidence != one.log_evidence


def test_prior_draws_are_of_the_prior():
    posterior = build_posterior(experiment(), Choices(), experiment().with_role("fit"))
    draws = draw_priors(posterior, 400, np.random.default_rng(0))
    assert draws.shape == (400, posterior.size)
    m = posterior.model.elastic.m
    standard = (draws[:, 0] - float(m.log_median)) / float(m.log_sd)
    assert kstest(standard, "norm").pvalue > 1e-3


@pytest.mark.slow
def test_nested_sampling_agrees_with_laplace_on_a_real_pad():
    """One relaxation mode over one test: few numbers, a quick run."""
    one = experiment()
    alone = replace(one, trials=one.with_role("fit"))
    search = build_search(alone, Choices(modes=1), kinds=())
    search.evaluate(search.baseline)
    (found,) = nested_audit(search)
    assert found.effect == "exponential, prony:1"
    assert found.error < 1.0  # more would agree with anything
    assert abs(found.log_evidence - found.laplace) < 3.0 * found.error + 0.5
