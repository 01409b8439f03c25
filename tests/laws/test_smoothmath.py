"""Divided differences of the exponential against extended precision, also at 0/0."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

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


@pytest.mark.parametrize("bottom", [1e-30, 0.7, 1e30])
def test_difference_ratio_is_the_mean_of_the_exponential_over_the_gap(bottom):
    gap = POINTS[np.abs(POINTS) < 500.0]
    top = (bottom * np.exp(gap.astype(np.longdouble))).astype(float)
    ratio = exp_difference_ratio(jnp.asarray(top), bottom * jnp.ones(gap.size), jnp.asarray(gap))
    exact = bottom * exact_slope(gap)
    # ten roundings' worth where top and bottom nearly cancel
    assert np.all(np.abs(ratio - exact.astype(float)) <= 1e-14 * exact)


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
