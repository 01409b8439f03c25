"""Transforms: there and back again, and the volume they say they take."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qlvbayes.priors.joint import (
    from_between,
    from_simplex,
    to_between,
    to_interval,
    to_simplex,
)

NUMBER = st.floats(-8.0, 8.0)
QUICK = settings(max_examples=15, deadline=None, derandomize=True)
ENDS = [(None, None), (-1.5, None), (None, 0.7), (-1.5, 0.7)]  # the last by an interval


def log_slope(function, y):
    return jnp.log(jnp.abs(jax.jacfwd(lambda x: function(x)[0])(y)))


@pytest.mark.parametrize(("low", "high"), ENDS)
@given(y=NUMBER)
@QUICK
def test_between_any_two_ends(low, high, y):
    low, high = (None if end is None else jnp.asarray(end) for end in (low, high))
    value, log_volume = to_between(jnp.asarray(y), low, high)
    assert low is None or value > low
    assert high is None or value < high
    assert np.isclose(from_between(value, low, high), y, atol=1e-10)
    slope = log_slope(lambda x: to_between(x, low, high), jnp.asarray(y))
    assert np.isclose(log_volume, slope, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("pieces", [1, 4])
@given(data=st.data())
@QUICK
def test_simplex(pieces, data):
    y = jnp.array(data.draw(st.lists(NUMBER, min_size=pieces, max_size=pieces)))
    fractions, log_volume = to_simplex(y)
    assert np.all(fractions > 0.0)
    assert np.isclose(fractions.sum(), 1.0, rtol=1e-14)
    assert np.allclose(from_simplex(fractions), y, atol=1e-9)
    jacobian = jax.jacfwd(lambda x: to_simplex(x)[0][:-1])(y)
    assert np.isclose(log_volume, jnp.linalg.slogdet(jacobian)[1], rtol=1e-10, atol=1e-10)


def test_simplex_at_zero_is_even_and_of_one_piece_is_whole():
    assert np.allclose(to_simplex(jnp.zeros(4))[0], 0.2, rtol=1e-14)
    fractions, log_volume = to_simplex(jnp.zeros(0))
    assert fractions.tolist() == [1.0]
    assert log_volume == 0.0


@pytest.mark.parametrize("y", [-700.0, 700.0])
def test_extreme_numbers_leave_finite_volumes_and_slopes(y):
    point = jnp.array([y, -y, y])
    for function in (lambda x: to_simplex(x)[1], lambda x: to_interval(x[0], 0.0, 1.0)[1]):
        assert np.isfinite(function(point))
        assert np.all(np.isfinite(jax.grad(function)(point)))
