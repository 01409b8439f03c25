"""The stiffness that is measured without the model, against pads whose stiffness is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qlvbayes.io.data import Test
from qlvbayes.motion.falling import largest_stiffness


def pressed(force_of, depth=1.6, points=400, back=True):
    """A pad without memory that is pressed and, unless not, let go again."""
    way = np.linspace(0.0, depth, points)
    displacement = np.concatenate([way, way[::-1]]) if back else way
    time = np.arange(float(displacement.size))
    return Test("1", "B", time, displacement, force_of(displacement))


@given(m=st.floats(0.1, 10.0), b=st.floats(0.05, 2.5), sign=st.sampled_from([1.0, -1.0]))
def test_lies_between_the_slopes_at_both_ends_of_the_last_quarter(m, b, sign):
    """The stiffness is that of an exponential pad, pressed or (as some cells count) pulled."""
    test = pressed(lambda d: sign * m / b * np.expm1(b * d))
    low, high = m * np.exp(b * 0.75 * 1.6), m * np.exp(b * 1.6)
    assert low < largest_stiffness([test]) < high


def test_is_taken_where_the_force_is_largest_among_all_tests():
    """The soft test reaches as deep."""
    soft, hard = pressed(lambda d: 1.0 * d), pressed(lambda d: 3.0 * d)
    assert largest_stiffness([soft, hard]) == pytest.approx(3.0)


def test_force_largest_at_no_depth_leaves_the_secant():
    """A pad that pulls back, as it leaves the platen, harder than it was pressed."""
    test = pressed(lambda d: 1.0 * d)
    test.force[-1] = -4.0
    assert largest_stiffness([test]) == pytest.approx(4.0 / 1.6)
