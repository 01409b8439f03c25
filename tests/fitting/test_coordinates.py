"""The coordinates of a chain: a shear of theta that makes one exact reading a plane."""

from dataclasses import replace

import numpy as np
import pytest
from support.endtoend import experiment

from qlvbayes.fitting.coordinates import Coordinates, best_reading
from qlvbayes.fitting.ensemble import Settings, sample
from qlvbayes.fitting.least_squares import NormalApproximation
from qlvbayes.fitting.marginal_likelihood import white_likelihood
from qlvbayes.fitting.optimum import predictor_of
from qlvbayes.fitting.posterior import Posterior, Predictor
from qlvbayes.model.choices import Choices
from qlvbayes.model.noise import White
from qlvbayes.model.parameters import draw_priors

NOISE = 30.0  # N, which drowns a test of some newtons
SHARE = 1e-3  # of its force: sd of the one good reading


def posterior(elastic="exponential", relaxation="prony"):
    """Return the posterior of one test drowned in noise, but for the last reading of the hold."""
    choices = Choices(elastic=elastic, relaxation=relaxation)
    built = predictor_of(experiment(), choices, experiment().with_role("fit"))
    blocks = built.record.blocks
    weight = np.asarray(blocks.weight).copy()
    best = good_block(built.record)
    count = float(np.asarray(blocks.count)[0, best])
    force = float(np.asarray(blocks.force)[0, best])
    weight[0, best] = SHARE * force * np.sqrt(count) / NOISE
    record = replace(built.record, blocks=replace(blocks, weight=weight))
    own, noise = Predictor.from_model(built.model, White(NOISE), record), White(NOISE)
    return Posterior(
        own.space, own.hypothesis, noise, white_likelihood(noise, record.blocks, NOISE)
    )


def good_block(record):
    displacement = np.asarray(record.motion.displacement)[0]
    held = displacement[np.asarray(record.nodes)[0]].min(axis=1) >= 0.999 * displacement.max()
    return int(np.flatnonzero(held & np.asarray(record.blocks.real)[0])[-1])


def thin(about):
    """A normal of the prior's spread, as thin as the good reading's error allows."""
    draws = draw_priors(about.model, 500, np.random.default_rng(1))
    mean, covariance = draws.mean(axis=0), np.cov(draws, rowvar=False)
    own, (depth, time) = about.parameters, best_reading(about.record)

    def log_force(theta):
        model = own.model_at(own.constants(theta[None])[0])
        return np.log(model.relaxation.curve(np.array(time)) * model.elastic.force(np.array(depth)))

    steps = 1e-6 * np.eye(about.size)
    slope = np.array([log_force(mean + s) - log_force(mean - s) for s in steps]) / 2e-6
    along = covariance @ slope
    variance = slope @ along
    less = np.outer(along, along) * (1.0 - SHARE**2 / variance) / variance
    return NormalApproximation(mean, covariance - less)


@pytest.mark.parametrize(
    ("elastic", "relaxation"), [("exponential", "prony"), ("hertz", "prony"), ("toe", "stretched")]
)
def test_the_map_is_a_shear_and_has_an_inverse(elastic, relaxation):
    own = posterior(elastic, relaxation)
    start = thin(own)
    coordinates = Coordinates.from_posterior(own, start)
    assert coordinates.index is not None
    theta = own.parameters.within(start.draw(5, np.random.default_rng(2)))
    there = coordinates.from_theta(theta)
    np.testing.assert_allclose(coordinates.to_theta(there), theta, rtol=0, atol=1e-12)
    step = 1e-6
    moved = coordinates.from_theta(theta[0] + step * np.eye(own.size))
    jacobian = (moved - there[0]) / step
    assert np.linalg.det(jacobian) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(jacobian - np.eye(own.size)).max() > 0.1


def test_theta_stays_where_no_constant_scales_the_force_or_it_has_none():
    own = posterior("polynomial:2")
    start = thin(own)
    coordinates = Coordinates.from_posterior(own, start)
    assert coordinates.index is None
    theta = start.draw(5, np.random.default_rng(2))
    assert coordinates.from_theta(theta) is coordinates.to_theta(theta) is theta
    assert coordinates.of_normal(start) is start
    own = posterior()
    still = np.zeros_like(own.record.motion.displacement)
    motion = replace(own.record.motion, displacement=still)
    untouched = own.over(replace(own.record, motion=motion))
    assert Coordinates.from_posterior(untouched, thin(own)).index is None


@pytest.mark.slow
def test_one_good_reading_among_noise_does_not_stop_the_walkers():
    """Its force is known to a thousandth, and what makes it up by the priors alone."""
    own = posterior()
    best = good_block(own.record)
    chain = sample(own, thin(own), Settings(seed=3, max_steps=12_000))
    assert chain.enough
    assert chain.acceptance > 0.15
    thetas = chain.theta[::10].reshape(-1, own.size)
    rows = np.random.default_rng(0).choice(len(thetas), 500, replace=False)
    forces = own.forces(own.parameters.constants(thetas[rows]))[:, 0, best]
    force = float(np.asarray(own.record.blocks.force)[0, best])
    assert forces.mean() == pytest.approx(force, abs=0.25 * SHARE * force)
    assert forces.std() == pytest.approx(SHARE * force, rel=0.2)
    assert thetas[:, 0].std() > 100.0 * SHARE
