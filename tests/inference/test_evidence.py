"""Densities of hypotheses: the fast way against dense algebra, quadrature and the plain model."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.linalg import block_diag
from scipy.optimize import minimize
from scipy.stats import multivariate_normal
from support.spaces import space_of

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.inference.density import Density, Terms
from qlvbayes.inference.errors.discrepancy import Discrepancy
from qlvbayes.inference.errors.features import UNDECIDED
from qlvbayes.inference.errors.scatter import NONE
from qlvbayes.inference.errors.whitening import Whitener, covariance
from qlvbayes.inference.evidence import evidence
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import bounded_step, find_mode, modes, predicted_decrease
from qlvbayes.inference.starts import projected

PEAK = 1.0


@pytest.fixture(scope="module")
def space(experiment):
    return space_of(experiment, experiment.trials, EFFECTS)


@pytest.fixture(scope="module")
def density(experiment, space):
    whitener = Whitener.from_floor(experiment.floor, space.record.blocks, PEAK)
    rng = np.random.default_rng(3)
    shapes = rng.standard_normal((7, *space.record.blocks.force.shape))
    return Density(space, Discrepancy.from_features(shapes, whitener, 2.0, 0.01))


def thetas(space, hypothesis, count):
    rng = np.random.default_rng(1)
    own = space.parameters(hypothesis)
    found = np.zeros((count, own.size))
    for leaf in own.leaves:
        values = np.stack([leaf.prior.draw(rng) for _ in range(count)])
        for row, value in zip(found, values, strict=True):
            row[list(leaf.theta)] = np.asarray(leaf.prior.unconstrain(value))
    return found


def unfollowed(space, point, kept=(0, 1, 2, 3, 4, 5)):
    """1 - P over the blocks that count, P the projection on the rows of the Jacobian."""
    real = space.real
    slopes = np.concatenate([point.responses[:, k, real[k]] for k in kept], axis=1)
    slopes = slopes[np.any(slopes != 0.0, axis=1)]
    basis = np.linalg.qr((slopes / np.linalg.norm(slopes, axis=1)[:, None]).T)[0]
    return np.eye(len(basis)) - basis @ basis.T


def mean_covariance(floor, blocks):
    """Return the mean covariance of a test's noise over the floors that its dwells leave open."""
    floors, weights = floor.likely()
    return np.tensordot(weights, [covariance(one, blocks, PEAK) for one in floors], axes=1)


def dense_loss(experiment, density, point, size, kept=(0, 1, 2, 3, 4, 5)):
    """Minus log density by the whole covariance, less the constant that it leaves out."""
    record, features = density.space.record, density.discrepancy.features
    blocks, left = record.blocks, np.asarray(record.blocks.force) - point.predicted
    precisions = density.whitener.precisions
    loss = point.prior.loss + 0.5 * np.log(precisions / (2.0 * np.pi)).sum()
    parts, shapes, noise = [], [], []
    for k in kept:
        real = np.asarray(blocks.real)[k]
        one = type(blocks)(*(np.asarray(getattr(blocks, name))[k][real] for name in vars(blocks)))
        noise.append(mean_covariance(experiment.floor, one))
        parts.append(left[k][real])
        shapes.append(features[:, k, real])
    shape, residual = np.concatenate(shapes, axis=1), np.concatenate(parts)
    rest = unfollowed(density.space, point, kept)
    smooth = rest @ (shape.T @ shape) @ rest
    followed = np.eye(len(rest)) - rest
    timing = np.diag(np.concatenate([np.asarray(blocks.timing)[k][blocks.real[k]] for k in kept]))
    moments = rest @ timing**2 @ rest + followed @ timing**2 @ followed - timing**2
    whole = block_diag(*noise) + size**2 * (smooth + UNDECIDED.rough * np.eye(residual.size))
    whole += (size > 0.0) * moments
    return loss - multivariate_normal(np.zeros(len(whole)), whole).logpdf(residual)


@pytest.mark.parametrize("size", [0.0, 0.01, 0.4])
@pytest.mark.few(2)
def test_density_is_that_of_the_whole_covariance(experiment, density, space, size):
    hypothesis = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))
    point = density.at(hypothesis, thetas(space, hypothesis, 1)[0])
    assert density.terms(point, size).loss == pytest.approx(
        dense_loss(experiment, density, point, size)
    )


def test_gradient_is_the_slope_of_the_loss(density, space):
    hypothesis = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))
    theta = np.median(space.prior_draws(hypothesis), axis=0)
    theta[-1] = 0.5 * space.parameters(hypothesis).length[-1]
    size, step = 0.03, 1e-4 * space.parameters(hypothesis).length
    point = density.at(hypothesis, theta)
    gradient = density.terms(point, size).gradient
    for k, h in enumerate(step):
        moved = [theta + sign * h * np.eye(theta.size)[k] for sign in (-1.0, 1.0)]
        below, above = (
            density.loss(density.at(hypothesis, one), size, point.separation) for one in moved
        )
        slope = (above - below) / (2.0 * h)
        assert gradient[k] == pytest.approx(slope, rel=2e-3, abs=1e-2 / h * 1e-4)


def test_evidence_of_a_bounded_amplitude_agrees_with_quadrature(density):
    hypothesis = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))
    plain = Hypothesis("exponential", "prony:2")
    mode = modes(density, plain, [np.median(density.space.prior_draws(plain), axis=0)])[0]
    theta = np.append(mode.point.theta, 0.0)
    found = find_mode(density, hypothesis, theta)
    point = found.point
    space_own = point.own

    def log_at(amplitude):
        """The other numbers integrated out by the same normal, held at this amplitude."""
        moved = point.theta.copy()
        moved[-1] = amplitude
        here = replace(density.at(hypothesis, moved), separation=point.separation)
        logs = []
        for size, prior in zip(
            density.discrepancy.sizes, density.discrepancy.log_prior, strict=True
        ):
            terms = density.terms(here, float(size))
            g, h = terms.gradient[:-1], terms.curvature[:-1, :-1]
            log = -terms.loss + 0.5 * g @ np.linalg.solve(h, g) + prior
            log += 0.5 * (g.size * np.log(2 * np.pi) - np.linalg.slogdet(h)[1])
            logs.append(log)
        return np.logaddexp.reduce(logs)

    top = log_at(point.theta[-1])
    scale = float(space_own.length[-1])
    area, _ = quad(lambda a: np.exp(log_at(a * scale) - top), 0.0, 3.0, limit=200)
    expected = top + np.log(area * scale)
    assert evidence(density, point).log == pytest.approx(expected, abs=0.1)


def test_a_place_that_is_no_mode_has_less_evidence_than_the_mode_it_leads_to(density, space):
    hypothesis = Hypothesis("exponential", "prony:2")
    start = np.median(space.prior_draws(hypothesis), axis=0)
    mode = find_mode(density, hypothesis, start)
    assert evidence(density, density.at(hypothesis, start)).log < evidence(density, mode.point).log


def test_a_test_left_out_has_no_part_in_the_density(experiment, density, space):
    hypothesis = Hypothesis("exponential", "prony:2")
    fewer = density.without(density.whitener.tests == 2)
    point = fewer.at(hypothesis, np.median(space.prior_draws(hypothesis), axis=0))
    expected = dense_loss(experiment, fewer, point, 0.02, kept=(0, 1, 3, 4, 5))
    assert fewer.terms(point, 0.02).loss == pytest.approx(expected)


def test_blocks_left_out_of_a_test_have_no_part_in_the_density(density, space):
    """The rest's own covariance, not what is left of it in numbers that hold all of them."""
    out = np.zeros(density.whitener.tests.size, dtype=bool)
    out[3:20] = True
    fewer = density.without(out).whitener
    vector = np.random.default_rng(0).standard_normal((1, *space.record.blocks.force.shape))
    rows = ~out[density.whitener.tests == 0]
    own = vector[0, 0, density.whitener.blocks[0]][rows]
    sigma = density.whitener.covariances[0][np.ix_(rows, rows)]
    white = fewer(vector)[0, fewer.tests == 0]
    assert white @ white == pytest.approx(own @ np.linalg.solve(sigma, own))


@pytest.mark.parametrize("scale", [0.0, 0.01, 0.3, 3.0])
def test_the_likeliest_size_is_that_of_least_loss_wherever_it_is_looked_for(density, scale):
    rng = np.random.default_rng(5)
    found = density.discrepancy
    residual = rng.standard_normal(found.whitener.precisions.size)
    residual += scale * found.shapes.sum(axis=0)
    losses = -found.log_likelihoods(residual[None])[0]
    expected = found.sizes[int(np.argmin(losses))]
    assert {found.likeliest_size(residual, near) for near in found.sizes[::4]} == {expected}


@pytest.mark.parametrize(
    ("before", "after", "apart"),
    [
        (Hypothesis("linear", "prony:2"), Hypothesis("polynomial:3", "prony:2"), 1e-3),
        (Hypothesis("exponential", "prony:2"), Hypothesis("polynomial:3", "prony:2"), 0.02),
        (Hypothesis("exponential", "prony:2"), Hypothesis("exponential", "prony:3"), 0.01),
        (Hypothesis("exponential", "fung"), Hypothesis("exponential", "log-normal"), 0.03),
        (
            Hypothesis("exponential", "prony:3"),
            Hypothesis("exponential", "prony:2", frozenset({"extra_relaxation_mode"})),
            0.02,  # the priors' pull
        ),
    ],
    ids=["linear", "exponential", "prony", "fung", "one mode more"],
)
def test_a_law_in_anothers_place_follows_its_curve(density, space, before, after, apart):
    point = density.at(before, np.median(space.prior_draws(before), axis=0))
    theta = projected(space, point, after, np.median(space.prior_draws(after), axis=0))
    constants = space.parameters(after).constants(theta[None])
    part = "elastic" if before.elastic != after.elastic else "relaxation"
    goal = space.curve(before, part, point.constants[None])[0]
    found = space.curve(after, part, constants)[0]
    assert np.abs(found - goal).max() < apart * np.abs(goal).max()


def quadratic(gradient, curvature, theta, lowest, highest):
    """A density whose loss is a quadratic about a place, between bounds."""
    terms = Terms(0.0, np.asarray(gradient), np.asarray(curvature))
    own = SimpleNamespace(
        lowest=np.asarray(lowest), highest=np.asarray(highest), length=np.full(len(theta), 1e3)
    )
    separation = SimpleNamespace(scatter=NONE)
    point = SimpleNamespace(own=own, theta=np.asarray(theta), separation=separation)
    density = SimpleNamespace(
        discrepancy=SimpleNamespace(log_prior=np.zeros(1), sizes=np.zeros(1)),
        likeliest_size=lambda at, guess: 0.0,
        terms=lambda at, size: terms,
    )
    return density, point, terms


@pytest.mark.parametrize(("low", "high"), [(-0.3, 0.4), (0.5, 0.9), (4.0, 5.0), (-1.0, np.inf)])
def test_evidence_between_two_bounds_agrees_with_quadrature(low, high):
    """One number between bounds, correlated with a free one: also where the mode lies beyond."""
    gradient, curvature = np.array([0.7, -0.4]), np.array([[3.0, 1.1], [1.1, 2.0]])
    bounds = [low, -np.inf], [high, np.inf]
    theta = np.array([min(low + 0.1, high), 0.0])
    density, point, _ = quadratic(gradient, curvature, theta, *bounds)

    def value(y, x):
        z = np.array([x, y]) - theta
        return float(np.exp(-gradient @ z - 0.5 * z @ curvature @ z))

    area, _ = dblquad(value, low, min(high, 12.0), -12.0, 12.0, epsabs=1e-12)
    assert evidence(density, point).log == pytest.approx(np.log(area), abs=1e-6)


def test_a_step_between_bounds_ends_at_the_lowest_place_there():
    """It does for 200 quadratics; a damped step predicts a smaller fall."""
    rng = np.random.default_rng(8)
    for _ in range(200):
        jacobian, goal = rng.standard_normal((9, 4)), rng.standard_normal(9)
        low, high = -rng.uniform(0.0, 0.5, 4), rng.uniform(0.0, 0.5, 4)
        best = minimize(
            lambda x, a=jacobian, b=goal: 0.5 * np.sum((a @ x - b) ** 2),
            np.zeros(4),
            jac=lambda x, a=jacobian, b=goal: a.T @ (a @ x - b),
            bounds=list(zip(low, high, strict=True)),
            method="L-BFGS-B",
            options={"ftol": 1e-15, "gtol": 1e-12},
        )
        _, point, terms = quadratic(
            -jacobian.T @ goal, jacobian.T @ jacobian, np.zeros(4), low, high
        )
        step, damped = (bounded_step(terms, damping, point) for damping in (0.0, 1.0))
        assert np.all((step >= low) & (step <= high))
        assert predicted_decrease(terms, step) == pytest.approx(
            0.5 * goal @ goal - best.fun, rel=1e-6
        )
        assert (
            0.0 < predicted_decrease(terms, damped) <= predicted_decrease(terms, step) * (1 + 1e-9)
        )
