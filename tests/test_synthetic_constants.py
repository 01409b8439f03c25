"""Constants of the pads: ranges, and shares that sum to one."""

import numpy as np
import pytest

from qlvbayes.checks import InputError
from qlvbayes.synthetic import TABLE_1, Constants, draw_constants, pads_of_table_1


@pytest.mark.parametrize("pad", TABLE_1)
def test_shares_of_table_1_sum_to_one(pad):
    assert sum(TABLE_1[pad].c) == pytest.approx(1.0, abs=1e-12)


def test_random_pads_stay_in_the_ranges_around_the_paper():
    rng = np.random.default_rng(3)
    drawn = [draw_constants(rng) for _ in range(2000)]
    for values, low, high in [
        ([p.m for p in drawn], 0.2, 1.2),
        ([p.b for p in drawn], 0.3, 1.5),
        ([p.v[0] for p in drawn], 2.0, 15.0),
        ([p.v[1] for p in drawn], 0.05, 0.5),
    ]:
        place = np.log(np.array(values) / low) / np.log(high / low)
        assert place.min() >= 0
        assert place.max() <= 1
        # Log-uniform: the mean place is 1/2 within 5 standard errors.
        assert abs(place.mean() - 0.5) < 5 * np.sqrt(1 / 12 / len(values))
    assert min(min(p.c) for p in drawn) >= 0.03


@pytest.mark.parametrize(
    ("m", "b", "c", "v"),
    [
        (-1.0, 0.5, (1.0,), ()),
        (1.0, 0.0, (1.0,), ()),
        (1.0, 0.5, (0.5, 0.4), (1.0,)),
        (1.0, 0.5, (1.2, -0.2), (1.0,)),
        (1.0, 0.5, (0.5, 0.5), ()),
        (1.0, 0.5, (0.5, 0.5), (0.0,)),
        (float("nan"), 0.5, (1.0,), ()),
    ],
)
def test_impossible_constants_are_refused(m, b, c, v):
    with pytest.raises(InputError):
        Constants(m, b, c, v)


def test_an_unknown_pad_is_named_with_the_known_ones():
    assert list(pads_of_table_1(["C", "A"])) == ["C", "A"]
    with pytest.raises(InputError, match=r"'D'.*A, B, C"):
        pads_of_table_1(["A", "D"])
