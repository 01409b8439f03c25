"""Densities of hypotheses: the fast way against dense algebra, quadrature and the plain model."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from qlvbayes import prepare, read_study
from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.inference.density import Density
from qlvbayes.inference.discrepancy import Discrepancy
from qlvbayes.inference.evidence import evidence
from qlvbayes.inference.floor_covariance import covariance
from qlvbayes.inference.modes import find_mode, modes
from qlvbayes.inference.space import Hypothesis, Space, in_natural_amplitude, median
from qlvbayes.inference.whitening import Whitener
from qlvbayes.laws.catalogue import LAWS
from qlvbayes.laws.relaxation.prony import Prony

HIDDEN = Path(__file__).parents[1] / "data" / "hidden.csv"
PEAK = 1.0


@pytest.fixture(scope="module")
def experiment():
    return prepare(read_study(HIDDEN).pads[0])


@pytest.fixture(scope="module")
def space(experiment):
    scales = experiment.scales
    relaxation = {f"prony:{k}": Prony.of_modes(scales, k) for k in (2, 3)}
    relaxation |= {kind.name: kind.default(scales) for kind in LAWS.relaxation if kind != Prony}
    return Space(
        experiment.record(experiment.trials),
        {kind.name: kind.default(scales) for kind in LAWS.elastic},
        relaxation,
        {kind.name: in_natural_amplitude(kind.default(scales)) for kind in EFFECTS},
        experiment.noise_at_rest,
        False,
    )


@pytest.fixture(scope="module")
def density(experiment, space):
    whitener = Whitener.of(experiment.floor, space.record.blocks, PEAK)
    rng = np.random.default_rng(3)
    shapes = rng.standard_normal((7, *space.record.blocks.force.shape))
    return Density(space, whitener, Discrepancy.of(whitener(shapes), 2.0, 0.01))


def thetas(space, hypothesis, count):
    rng = np.random.default_rng(1)
    own = space.parameters(hypothesis)
    found = np.zeros((count, own.size))
    for leaf in own.leaves:
        values = np.stack([leaf.prior.draw(rng) for _ in range(count)])
        for row, value in zip(found, values, strict=True):
            row[list(leaf.theta)] = np.asarray(leaf.prior.unconstrain(value))
    return found


@pytest.mark.parametrize(
    "hypothesis",
    [
        Hypothesis("exponential", "prony:2"),
        Hypothesis("hertz", "prony:3", frozenset({"squeeze_film", "contact_offset"})),
        Hypothesis("polynomial:3", "fung", frozenset({"friction"})),
        Hypothesis("toe", "power-law"),
        Hypothesis("exponential", "prony:2", frozenset({"frame_compliance", "inertia"})),
    ],
    ids=lambda h: f"{h.elastic}-{h.relaxation}-{len(h.effects)}",
)
def test_engine_gives_the_forces_of_the_models_it_stands_for(space, hypothesis):
    own = space.parameters(hypothesis)
    constants = own.constants(thetas(space, hypothesis, 3))
    found = space.forces(hypothesis, constants)
    for row, force in zip(constants, found, strict=True):
        model, _ = own.posterior.with_constants(jnp.asarray(row))
        expected = np.asarray(own.posterior.predict_with(model))
        np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def dense_loss(density, point, size):
    """Minus log density by the whole covariance."""
    whitener = density.whitener
    shapes = density.discrepancy.shapes
    wide = np.eye(whitener.tests.size) + size**2 * shapes.T @ shapes
    log = multivariate_normal(np.zeros(len(wide)), wide).logpdf(point.residual)
    log += 0.5 * len(wide) * np.log(2.0 * np.pi)  # left out, as it is everywhere the same
    return -log + point.prior.loss


@pytest.mark.parametrize("size", [0.0, 0.01, 0.4])
def test_density_is_that_of_the_whole_covariance(density, space, size):
    hypothesis = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))
    point = density.at(hypothesis, thetas(space, hypothesis, 1)[0])
    assert density.terms(point, size).loss == pytest.approx(dense_loss(density, point, size))


def test_whitened_products_are_those_of_the_covariance(experiment, space, density):
    blocks = space.record.blocks
    rng = np.random.default_rng(0)
    vectors = rng.standard_normal((2, *blocks.force.shape))
    white = density.whitener(vectors)
    expected = 0.0
    for k, real in enumerate(np.asarray(blocks.real)):
        one = type(blocks)(*(np.asarray(getattr(blocks, name))[k][real] for name in vars(blocks)))
        sigma = covariance(experiment.floor, one, PEAK)
        expected += vectors[0, k, real] @ np.linalg.solve(sigma, vectors[1, k, real])
    assert white[0] @ white[1] == pytest.approx(expected)


def test_gradient_is_the_slope_of_the_loss(density, space):
    hypothesis = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))
    theta = median(space.plain_draws(hypothesis))
    theta[-1] = 0.5 * space.parameters(hypothesis).length[-1]
    size, step = 0.03, 1e-4 * space.parameters(hypothesis).length
    gradient = density.terms(density.at(hypothesis, theta), size).gradient
    for k, h in enumerate(step):
        losses = [
            density.terms(density.at(hypothesis, theta + sign * h * np.eye(theta.size)[k]), size)
            for sign in (-1.0, 1.0)
        ]
        slope = (losses[1].loss - losses[0].loss) / (2.0 * h)
        assert gradient[k] == pytest.approx(slope, rel=2e-3, abs=1e-2 / h * 1e-4)


def test_evidence_of_a_bounded_amplitude_agrees_with_quadrature(density):
    hypothesis = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))
    plain = Hypothesis("exponential", "prony:2")
    mode = modes(density, plain, [median(density.space.plain_draws(plain))])[0]
    theta = np.append(mode.point.theta, 0.0)
    found = find_mode(density, hypothesis, theta)
    point = found.point
    space_own = point.own

    def log_at(amplitude):
        """The other numbers integrated out by the same normal, held at this amplitude."""
        moved = point.theta.copy()
        moved[-1] = amplitude
        here = density.at(hypothesis, moved)
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
    start = median(space.plain_draws(hypothesis))
    mode = find_mode(density, hypothesis, start)
    assert evidence(density, density.at(hypothesis, start)).log < evidence(density, mode.point).log


def test_a_test_left_out_has_no_part_in_the_density(density, space):
    hypothesis = Hypothesis("exponential", "prony:2")
    theta = median(space.plain_draws(hypothesis))
    whole, fewer = (
        density.at(hypothesis, theta),
        density.without(density.whitener.tests == 2).at(hypothesis, theta),
    )
    kept = density.whitener.tests != 2
    np.testing.assert_allclose(fewer.residual, whole.residual[kept])
    size = 0.02
    shapes = density.discrepancy.shapes[:, kept]
    wide = np.eye(kept.sum()) + size**2 * shapes.T @ shapes
    log = multivariate_normal(np.zeros(len(wide)), wide).logpdf(fewer.residual)
    expected = -log - 0.5 * len(wide) * np.log(2.0 * np.pi) + fewer.prior.loss
    assert density.without(density.whitener.tests == 2).terms(fewer, size).loss == pytest.approx(
        expected
    )
