"""Priors: densities that integrate to one, in order, and draws that follow them."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from qlvbayes.model.parameters import value_shape
from qlvbayes.priors import Dirichlet, HalfNormal, LogNormal, LogUniform, Normal, Ordered, Uniform
from qlvbayes.priors.joint import to_between, to_simplex

RATE = LogNormal(0.3, 1.4)
SCALARS = [
    (Normal(-0.4, 1.7), stats.norm(-0.4, 1.7)),
    (LogNormal(1.8, 0.5), stats.lognorm(0.5, scale=np.exp(1.8))),
    (HalfNormal(0.02), stats.halfnorm(scale=0.02)),
    (Uniform(0.2, 3.0), stats.uniform(0.2, 2.8)),
    (LogUniform(0.01, 30.0), stats.loguniform(0.01, 30.0)),
]
PLANES = [
    Dirichlet([2.5, 0.7, 4.0]),
    Dirichlet([1.5, 2.0, 1.2, 3.0], fixed={1: 0.25}),
    Ordered((LogNormal(1.8, 0.5), HalfNormal(2.0))),
    Ordered((RATE, 1.3, RATE)),
    Ordered((5.0, RATE, RATE)),
    Ordered((RATE, RATE, 0.2)),
]
LINES = [
    Dirichlet([2.0, 3.0]),
    Dirichlet([1.5, 2.0, 1.2], fixed={0: 0.3}),
    Ordered((RATE,)),
    Ordered((RATE, 0.14)),
    Ordered((6.2, RATE)),
    Ordered((6.2, LogNormal(0.0, 0.3), 0.14)),
    Ordered((LogNormal(1.8, 1e-3), 0.14)),
    Ordered((LogNormal(1.8, 1e-3), 6.0)),
]
ALL = [*(prior for prior, _ in SCALARS), *PLANES, *LINES]


def density(prior):
    return jax.jit(jax.vmap(lambda y: jnp.exp(prior.constrain(y)[1])))


def line_integral(prior):
    at = jax.jit(lambda y: jnp.exp(prior.constrain(jnp.array([y]))[1]))
    draws = [prior.unconstrain(prior.draw(np.random.default_rng(k)))[0] for k in range(200)]
    middle, spread = np.median(draws), np.std(draws)
    parts = middle + spread * np.array([-40.0, -8.0, -2.0, 0.0, 2.0, 8.0, 40.0])
    ends = pairwise(parts)
    return sum(quad(lambda y: float(at(y)), *pair, epsabs=1e-10, limit=200)[0] for pair in ends)


def plane_integral(prior):
    """Trapezoid over a wide square, spectrally accurate for densities this smooth."""
    draws = [prior.unconstrain(prior.draw(np.random.default_rng(k))) for k in range(400)]
    middle, spread = np.median(draws, axis=0), np.std(draws, axis=0)
    steps = np.linspace(-14.0, 14.0, 401)
    x, y = (middle[k] + spread[k] * steps for k in (0, 1))
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return float(np.sum(density(prior)(jnp.asarray(points)))) * (x[1] - x[0]) * (y[1] - y[0])


@pytest.mark.parametrize("prior", [prior for prior, _ in SCALARS] + LINES, ids=repr)
def test_a_density_over_one_number_integrates_to_one(prior):
    assert line_integral(prior) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("prior", PLANES, ids=repr)
def test_a_density_over_two_numbers_integrates_to_one(prior):
    assert plane_integral(prior) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(("prior", "reference"), SCALARS, ids=[repr(p) for p, _ in SCALARS])
def test_scalar_densities_and_draws_are_scipys(prior, reference):
    values = reference.ppf(np.linspace(0.001, 0.999, 30))
    assert np.allclose(prior.log_density(values), reference.logpdf(values), rtol=1e-12, atol=1e-12)
    rng = np.random.default_rng(7)
    draws = [float(prior.draw(rng)) for _ in range(2000)]
    # a false alarm once in a hundred thousand
    assert stats.kstest(draws, reference.cdf).pvalue > 1e-5


@pytest.mark.parametrize("prior", ALL, ids=repr)
def test_a_drawn_value_comes_back_from_its_numbers(prior):
    rng = np.random.default_rng(11)
    for _ in range(20):
        value = prior.draw(rng)
        y = prior.unconstrain(value)
        assert y.shape == (prior.size,)
        back, log_density = prior.constrain(y)
        assert np.shape(value) == back.shape == value_shape(prior)
        assert np.allclose(back, value, rtol=1e-9)
        assert not isinstance(prior, Ordered) or np.all(np.diff(back) < 0.0)
        assert np.isfinite(log_density)


@pytest.mark.parametrize("prior", ALL, ids=repr)
def test_slopes_of_the_density_are_finite_far_out(prior):
    slope = jax.jit(jax.grad(lambda y: prior.constrain(y)[1]))
    for place in (-20.0, -3.0, 0.0, 3.0, 5.0):
        assert np.all(np.isfinite(slope(jnp.full(prior.size, place))))


@pytest.mark.parametrize("prior", PLANES[:2], ids=repr)
def test_dirichlet_is_scipys_with_the_fixed_fractions_left_alone(prior):
    fixed = {k: float(x) for k, x in enumerate(prior.values) if k not in prior.free}
    free, rest = list(prior.free), 1.0 - sum(fixed.values())
    reference = stats.dirichlet(np.asarray(prior.alpha)[free])
    constrain = jax.jit(lambda y: prior.constrain(y))
    slopes = jax.jit(jax.jacfwd(lambda y: prior.constrain(y)[0]))
    rng = np.random.default_rng(5)
    for y in rng.standard_normal((10, prior.size)):
        fractions, log_density = constrain(jnp.asarray(y))
        assert all(fractions[k] == x for k, x in fixed.items())
        assert np.isclose(fractions.sum(), 1.0, rtol=1e-14)
        shares = np.asarray(fractions)[free] / rest
        volume = np.linalg.slogdet(np.asarray(slopes(y))[free[:-1]] / rest)[1]
        assert np.isclose(log_density, reference.logpdf(shares / shares.sum()) + volume, atol=1e-9)


@pytest.mark.parametrize("modes", [1, 4])
def test_alike_rates_fall_in_order_once_in_r_factorial(modes):
    prior = Ordered((RATE,) * modes)
    assert prior.log_normaliser == pytest.approx(-np.sum(np.log(np.arange(1, modes + 1))), abs=1e-5)


def test_probability_of_order_against_closed_forms():
    pair = Ordered((LogNormal(1.0, 0.3), LogNormal(0.5, 0.4)))
    assert pair.log_normaliser == pytest.approx(stats.norm.logcdf(0.5 / 0.5), abs=1e-5)
    middle = Ordered((RATE, 2.0, RATE))
    below = stats.norm.cdf((np.log(2.0) - 0.3) / 1.4)
    assert middle.log_normaliser == pytest.approx(np.log(below * (1.0 - below)), abs=1e-6)
    assert Ordered((6.2, 0.14)).log_normaliser == 0.0
    narrow = Ordered((LogNormal(1.8, 1e-4), LogNormal(1.8, 1e-4)))
    assert narrow.log_normaliser == pytest.approx(-np.log(2.0), abs=1e-5)


def test_a_log_normal_has_no_density_at_zero_and_descriptions_read_as_on_the_command_line():
    """Far in the tail of an ordered pair a rate underflows; there is no nan there."""
    assert RATE.log_density(0.0) == -jnp.inf
    _, density = Ordered((RATE, RATE)).constrain(jnp.array([2.0, 8.0]))
    assert density == -jnp.inf
    assert LogNormal(1.8, 0.5).describe() == "lognormal(1.8, 0.5)"
    assert Dirichlet([1.0, 1.0, 2.0], fixed={0: 0.3}).describe() == "dirichlet(1, 1, 2), [0] = 0.3"
    assert Ordered((RATE, 0.14)).describe() == "lognormal(0.3, 1.4) > 0.14"


def test_ordered_draws_have_the_moments_of_the_density():
    """The larger of two like normals has mean mu + sd/sqrt(pi): here in the logarithm."""
    prior = Ordered((RATE, RATE))
    rng = np.random.default_rng(3)
    logs = np.log([prior.draw(rng) for _ in range(4000)])
    expected = 0.3 + 1.4 / np.sqrt(np.pi) * np.array([1.0, -1.0])
    sd = 1.4 * np.sqrt(1.0 - 1.0 / np.pi)
    assert np.all(np.abs(logs.mean(axis=0) - expected) < 4.5 * sd / np.sqrt(4000))
    steps = np.linspace(-12.0, 12.0, 601)
    points = jnp.asarray(np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2))
    rates = jnp.log(jax.vmap(lambda y: prior.constrain(y)[0])(points))
    weights = density(prior)(points)[:, None]
    moments = jnp.sum(jnp.where(weights > 0.0, weights * rates, 0.0), 0) / jnp.sum(weights)
    assert np.allclose(moments, expected, atol=1e-6)


@pytest.mark.parametrize("y", [-700.0, 700.0])
def test_extreme_numbers_leave_finite_volumes_and_slopes(y):
    """Of the maps to fractions and to an interval; a whole number of pieces is even at zero."""
    assert np.allclose(to_simplex(jnp.zeros(4))[0], 0.2, rtol=1e-14)
    point = jnp.array([y, -y, y])
    for function in (lambda x: to_simplex(x)[1], lambda x: to_between(x[0], 0.0, 1.0)[1]):
        assert np.isfinite(function(point))
        assert np.all(np.isfinite(jax.grad(function)(point)))
