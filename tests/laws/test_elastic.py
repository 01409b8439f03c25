"""Elastic laws: stiffness is the slope of the force, a step its integral, also at 0/0."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from qlvbayes.laws.catalogue import LAWS as KNOWN
from qlvbayes.laws.conformance import check_law
from qlvbayes.laws.elastic.exponential import Exponential, ToeExponential
from qlvbayes.laws.elastic.polynomial import Cubic, HertzPower, Linear, Quadratic
from qlvbayes.laws.elastic.spline import Spline
from qlvbayes.laws.smoothmath import exp_difference_ratio, exp_slope

SIZES = np.concatenate([np.geomspace(1e-300, 1e-3, 40), np.geomspace(1e-3, 600.0, 400)])
POINTS = np.concatenate([-SIZES[::-1], [0.0], SIZES, [0.1, -0.1, np.nextafter(0.1, 0.0)]])


def exact_slope(x):
    """(e^x - 1)/x in extended precision."""
    wide = np.where(x == 0.0, 1.0, x).astype(np.longdouble)
    return np.where(x == 0.0, 1.0, np.expm1(wide) / wide)


def exact_derivative(x):
    """d/dx of (e^x - 1)/x in extended precision; Taylor series where the formula cancels."""
    wide = x.astype(np.longdouble)
    near = np.abs(x) < 1.0
    term, series = np.ones_like(wide) / 2, np.zeros_like(wide)
    for k in range(1, 30):
        series += np.where(near, term, 0)
        term = np.where(near, term * wide * (k + 1) / (k * (k + 2)), 0)
    far = np.where(near, 1, wide)
    return np.where(near, series, (np.exp(far) * (far - 1) + 1) / far**2)


def test_slope_and_its_derivative_are_exact_from_underflow_to_overflow():
    assert np.allclose(exp_slope(POINTS), exact_slope(POINTS).astype(float), rtol=3e-15, atol=0)
    assert exp_slope(0.0) == 1.0
    derivative = jax.vmap(jax.grad(exp_slope))(jnp.asarray(POINTS))
    assert np.allclose(derivative, exact_derivative(POINTS).astype(float), rtol=1e-13, atol=0)


def test_difference_ratio_has_finite_slopes_and_the_exact_ones_at_zero_over_zero():
    zero, one = jnp.array(0.0), jnp.array(1.0)
    for gap in (-1e4, -1e300):
        slopes = jax.grad(exp_difference_ratio, argnums=(0, 1, 2))(zero, one, jnp.array(gap))
        assert np.all(np.isfinite(slopes))
    for gap in (1e4, 1e300):
        slopes = jax.grad(exp_difference_ratio, argnums=(0, 1, 2))(one, zero, jnp.array(gap))
        assert np.all(np.isfinite(slopes))

    def ratio(low, gap):
        return exp_difference_ratio(jnp.exp(low + gap), jnp.exp(low), gap)

    low = 0.3
    by_low, by_gap = jax.grad(ratio, argnums=(0, 1))(low, 0.0)
    assert np.isclose(by_low, np.exp(low), rtol=1e-14)
    assert np.isclose(by_gap, 0.5 * np.exp(low), rtol=1e-14)


NODES, WEIGHTS = leggauss(40)
LAWS = [
    Linear(0.4),
    Exponential(0.34, 1.165),
    Exponential(0.34, -0.7),
    Exponential(0.34, 0.0),
    Quadratic(0.3, 0.2),
    Cubic(0.3, -0.1, 0.15),
    ToeExponential(0.3, 1.2, 0.45),
    ToeExponential(0.3, 0.0, 0.0),
    HertzPower(0.5, 1.5),
    Spline(0.3, 0.35, 0.4, 0.9, 1.1, 0.8, 1.5, depth=1.5),
]
CLOSED_FORM = LAWS[:-2]
DECAYS = [0.0, 1e-12, 1e-3, 0.0999, 0.1001, 0.3, 1.0, 30.0, 1e4]


def step(law, start, stop, decay):
    start, stop, decay = (jnp.asarray(x, dtype=float) for x in (start, stop, decay))
    return law.relaxed_step(start, stop, law.force(start), law.force(stop), decay)


def integral(law, start, stop, decay):
    """Integral over the step, in panels that shrink toward its end as e^{-decay (1 - s)} does."""
    far = np.concatenate([[0.0], np.geomspace(1e-6, 1.0, 60)])
    edges = 1.0 - far[::-1]
    if isinstance(law, ToeExponential) and start != stop:  # a panel ends where stiffness has a kink
        kink = (law.toe - start) / (stop - start)
        edges = np.sort(np.append(edges, kink)) if 0.0 < kink < 1.0 else edges
    half = 0.5 * np.diff(edges)[:, None]
    s = edges[:-1, None] + half * (1.0 + NODES)
    stiffness = np.asarray(law.stiffness(jnp.asarray(start + (stop - start) * s)))
    return np.sum(half * WEIGHTS * np.exp(-decay * (1.0 - s)) * stiffness * (stop - start))


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_force_vanishes_at_zero_depth_and_stiffness_is_its_slope(law):
    depth = jnp.linspace(-0.5, 1.8, 24)
    assert law.force(jnp.zeros(())) == 0.0
    slope = jax.vmap(jax.grad(lambda d: law.force(d)))(depth)
    assert np.allclose(law.stiffness(depth), slope, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("decay", DECAYS)
@pytest.mark.parametrize("law", CLOSED_FORM, ids=repr)
def test_step_is_the_integral_over_loading_unloading_and_rest(law, decay):
    for start, stop in [(0.0, 1.6), (1.6, 0.8), (0.5, 0.5), (0.3, 0.3000001), (0.8, -0.2)]:
        exact = integral(law, start, stop, decay)
        assert np.isclose(step(law, start, stop, decay), exact, rtol=1e-12, atol=1e-16)


def test_step_is_exact_where_stiffening_and_decay_cancel_and_for_hertz_of_power_2():
    """B dd + v h = 0 on ordinary unloading: the integrand is the constant e^{b d1}."""
    law = Exponential(0.34, 1.25)
    start, stop, decay = 1.5, 0.7, 1.0
    assert law.b * (stop - start) + decay == pytest.approx(0.0, abs=1e-15)
    expected = 0.34 * np.exp(1.25 * stop) * (stop - start)
    assert np.isclose(step(law, start, stop, decay), expected, rtol=1e-14)
    law = HertzPower(0.5, 2.0)
    for decay in DECAYS:
        exact = integral(law, 0.2, 1.4, decay)
        assert np.isclose(step(law, 0.2, 1.4, decay), exact, rtol=1e-11)


@pytest.mark.parametrize("kind", KNOWN.elastic, ids=lambda kind: kind.name)
@pytest.mark.few(1)
def test_every_elastic_law_keeps_the_rules(kind):
    check_law(kind)
