"""The validation of comparisons: its statistics on numbers whose answer is known, and one pair."""

import numpy as np
import pytest
from pairs import pooled_coverage
from simulated_pairs import KINDS, NEAR, draw_pair


def pair(index, rng, width=1.0, differ=None):
    """A pair whose differences have a normal error of sd 1 and intervals of that sd times width."""
    contrasts = {}
    for name in ("m", "b"):
        first, error = 10.0, rng.normal()
        half = 1.6449 * width
        contrasts[name] = {
            "group": "constants", "first": first, "second": first, "low": error - half,
            "high": error + half, "answer": "cannot tell",
        }  # fmt: skip
    found = {"index": index, "kind": KINDS[index % 4], "fit_seconds": 1.0, "compare_seconds": 1.0}
    return found | {
        "converged": [True, True], "differ": differ, "p_value": 0.5, "region": 0.1,
        "contrasts": contrasts,
    }  # fmt: skip


def test_right_intervals_hold_nine_in_ten_and_narrow_ones_fewer():
    rng = np.random.default_rng(0)
    share, error = pooled_coverage([pair(k, rng) for k in range(500)])
    assert abs(share - 0.9) < 4.0 * error
    assert error == pytest.approx(np.sqrt(0.09 / 1000), rel=0.15)
    share, error = pooled_coverage([pair(k, rng, width=0.5) for k in range(500)])
    assert abs(share - 0.589) < 4.0 * error  # erf(0.5 * 1.6449 / sqrt(2))


def test_pairs_are_equal_near_or_far():
    rng = np.random.default_rng(2)
    first, second = draw_pair("equal", rng)
    assert first == second
    shifts = []
    for _ in range(200):
        first, second = draw_pair("near", rng)
        assert sum(second.c) == pytest.approx(1.0)
        shifts += [np.log(second.m / first.m), np.log(second.v[1] / first.v[1])]
    assert np.std(shifts) == pytest.approx(NEAR, rel=0.15)
    first, second = draw_pair("far", rng)
    assert first.m != second.m
