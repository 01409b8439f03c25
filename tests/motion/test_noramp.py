"""A test without a loading ramp is refused with what its displacement does, and what to do."""

import numpy as np
import pytest

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.experiment import prepare

TIME = np.arange(0.0, 30.0, 0.02)
DOWN = np.interp(TIME, [0.5, 1.5], [60.0, 58.0])


def refused(displacement, force, units=("mm", "N")):
    noise = 1e-3 * np.random.default_rng(0).standard_normal(TIME.size)
    test = Test(name="slow", pad="B", time=TIME, displacement=displacement, force=force + noise)
    with pytest.raises(InputError) as caught:
        prepare(Pad("B", (test,), UnitSystem(*units)))
    text = str(caught.value)
    assert text.startswith("test slow of pad B holds no loading ramp: ")
    assert "\n" not in text
    return text


def test_a_position_that_falls_while_the_force_rises_is_to_be_turned_over():
    text = refused(DOWN, 60.0 - DOWN)
    assert "its displacement only falls, from 60 to 58 mm, while the force rises" in text
    assert "its value at first contact minus each value" in text


def test_an_unloading_alone_lacks_its_loading():
    text = refused(DOWN - 58.0, DOWN - 58.0)
    assert "only falls, from 2 to 0 mm, and the force falls with it" in text
    assert "add the rows of the loading before it" in text
    assert "multiply displacement and force by -1 if this is the loading" in text


def test_a_hold_alone_lacks_its_ramp():
    jitter = 2e-3 * (np.random.default_rng(1).random(TIME.size) > 0.5)
    text = refused(2.0 + jitter, np.exp(-TIME / 5.0))
    assert "its displacement changes by 0.002 mm only" in text
    assert "add the rows of the ramp before this hold, or delete the test" in text
