"""Constants of the pads: ranges, and shares that sum to one."""

import numpy as np
import pytest

from qlvbayes.io.checks import InputError
from qlvbayes.simulate import SPECIMENS, TABLE_1, Constants, draw_constants, specimens_of


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


def test_specimens_of_a_kind_are_alike_and_not_the_same():
    rng = np.random.default_rng(0)
    found, kinds = specimens_of(["B", "finger:40"], rng)
    assert found["B"] == TABLE_1["B"]
    assert kinds == {f"finger-{k}": "finger" for k in range(1, 41)}
    stiffness = np.log([found[name].m / SPECIMENS["finger"].m for name in kinds])
    # 40 draws of an sd of 0.2: their mean and sd to three errors
    assert abs(stiffness.mean()) < 3.0 * 0.2 / np.sqrt(40)
    assert stiffness.std() == pytest.approx(0.2, abs=3.0 * 0.2 / np.sqrt(80))
    assert len({found[name].v for name in kinds}) == 40


@pytest.mark.parametrize("word", ["D", "finger:0", "finger:two", "finger:", "hand:3"])
def test_unknown_specimens_are_refused(word):
    with pytest.raises(InputError, match="no pad"):
        specimens_of([word], np.random.default_rng(0))
