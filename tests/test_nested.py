"""Nested sampling and importance sampling against evidences that are known."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.stats as jss
import numpy as np
import pytest
from endtoend import experiment
from hidden_pads import ensemble_of
from scipy.stats import kstest, multivariate_normal

from qlvbayes.choices import Choices
from qlvbayes.diagnosis.contest import Round, contest, refit
from qlvbayes.diagnosis.evidence import LaplaceCheck, laplace_check, log_densities, sampled_evidence
from qlvbayes.diagnosis.nested_check import nested_check
from qlvbayes.diagnosis.screen import screen
from qlvbayes.diagnosis.search import plain_fits
from qlvbayes.effects.extra_relaxation_mode import ExtraRelaxationMode
from qlvbayes.effects.viscous_drag import ViscousDrag
from qlvbayes.fit import build_posterior
from qlvbayes.inference import nested
from qlvbayes.inference.nested import nested_evidence
from qlvbayes.inference.subset import Part, with_every_effect
from qlvbayes.posterior import draw_priors
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

    def log_likelihoods(self, theta):
        return jss.norm.logpdf(self.observed - self.slopes @ theta)

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


def test_the_evidence_of_a_straight_line_is_exact(straight):
    runs = [nested_evidence(straight, seed, live=60) for seed in range(4)]
    found = np.array([run.log_evidence for run in runs])
    errors = np.array([run.error for run in runs])
    assert np.all(np.abs(found - straight.exact) < 3.5 * errors)
    assert abs(found.mean() - straight.exact) < 3.0 * np.sqrt(np.mean(errors**2) / 4.0)
    assert np.all((errors > 0.1) & (errors < 0.8))


def test_draws_are_of_the_posterior(straight):
    runs = [nested_evidence(straight, seed, live=60, draws=500) for seed in range(4)]
    mean, sd = straight.moments
    together = np.concatenate([run.draws for run in runs])
    assert together.shape == (2000, 3)
    assert np.all(np.abs(together.mean(axis=0) - mean) < 0.4 * sd)
    np.testing.assert_allclose(together.std(axis=0), sd, rtol=0.3)


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


@pytest.fixture(scope="module")
def ensemble():
    return ensemble_of(experiment(), ViscousDrag, ExtraRelaxationMode)


@pytest.fixture(scope="module")
def first(ensemble):
    return contest(ensemble, plain_fits(ensemble)[0], ensemble.candidates)


def test_densities_are_those_of_the_smaller_posterior(ensemble, first):
    point = first.base
    thetas = point.theta + 0.01 * np.arange(3)[:, None]
    plain = Part.of(ensemble, frozenset()).posterior
    exact = [float(plain.log_density(x[point.subset.theta])) for x in thetas]
    np.testing.assert_allclose(log_densities(ensemble, point, thetas), exact, rtol=1e-10)
    assert log_densities(ensemble, point, thetas)[0] == pytest.approx(-point.loss, rel=1e-10)


def test_laplace_is_trusted_where_the_posterior_is_normal(ensemble, first):
    check = laplace_check(ensemble, first.base)
    assert isinstance(check, LaplaceCheck)
    assert check.reasons == ()
    assert check.effective_draws > 60.0
    assert abs(check.log_evidence - first.base.log_evidence) < 3.0 * check.error + 0.3
    other = laplace_check(ensemble, first.base, seed=1)
    assert abs(other.log_evidence - check.log_evidence) < 4.0 * np.hypot(other.error, check.error)


def test_a_direction_that_nothing_holds_does_not_stop_the_sampling(ensemble, first):
    """Its covariance has a condition number at which a Cholesky factor is refused."""
    values, vectors = np.linalg.eigh(first.base.curvature)
    values[0] = 1e-14 * values[-1]
    flat = replace(first.base, curvature=(vectors * values) @ vectors.T)
    assert np.isfinite(laplace_check(ensemble, flat).log_evidence)


@pytest.mark.parametrize(
    ("sampled", "worth", "taken"),
    [(5.0, 100.0, 5.0), (5.0, 1.0, 0.0), (-5.0, 100.0, -5.0), (-5.0, 1.0, -5.0)],
)
def test_one_far_draw_does_not_raise_the_evidence(first, monkeypatch, sampled, worth, taken):
    """Sampled evidence above Laplace's needs draws that are worth something."""
    laplace = first.base.log_evidence
    known = LaplaceCheck(laplace + sampled, 1.0, worth, ())
    monkeypatch.setattr("qlvbayes.diagnosis.evidence.laplace_check", lambda *given: known)
    assert sampled_evidence(None, first.base) == pytest.approx(laplace + taken)


def test_an_idle_effect_is_told(ensemble, first):
    """Pad B has no drag: its coefficient lies against zero, wherever the optimum is."""
    scores = screen(ensemble, first.base, ["viscous_drag"])["viscous_drag"]
    point = refit(ensemble, first.base, scores, -np.inf)
    reasons = laplace_check(ensemble, point).reasons
    assert any("viscous_drag" in reason for reason in reasons)


def test_nested_check_runs_none_and_the_best(ensemble, first, monkeypatch):
    asked = []

    def known(posterior, seed, *, live):
        asked.append((posterior.size, seed, live))
        return nested.NestedEvidence(-1.0, 0.5, 10, np.zeros((1, posterior.size)))

    monkeypatch.setattr("qlvbayes.diagnosis.nested_check.nested_evidence", known)
    told = []
    found = nested_check(ensemble, first, best=1, seed=3, live=20, tell=told.append)
    refitted = [c for c in first.contenders if c.point is not None][:1]
    assert [c.effect for c in found] == ["none", *(c.effect for c in refitted)]
    assert asked[0] == (first.base.subset.theta.size, 3, 20)
    assert found[0].laplace == first.base.log_evidence
    assert (found[0].log_evidence, found[0].error) == (-1.0, 0.5)
    assert len(told) == len(found)
    alone = nested_check(ensemble, Round(first.base, ()), live=20)
    assert [c.effect for c in alone] == ["none"]


def test_nested_sampling_agrees_on_a_real_pad():
    """One relaxation mode and white noise over one test: few numbers, a quick run."""
    trials = experiment().with_role("fit")
    posterior = build_posterior(experiment(), Choices(modes=1, noise="white"), trials)
    ensemble = with_every_effect(posterior, ())
    point = plain_fits(ensemble)[0]
    check = laplace_check(ensemble, point)
    (found,) = nested_check(ensemble, Round(point, ()), live=40)
    assert abs(check.log_evidence - point.log_evidence) < 0.5
    assert abs(found.log_evidence - check.log_evidence) < 3.0 * found.error + 0.5
