"""A test without a loading ramp is refused with what its displacement does, and what to do."""

import numpy as np
import pytest
from support.solids import made_ready

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Test

TIME = np.arange(0.0, 30.0, 0.02)
DOWN = np.interp(TIME, [0.5, 1.5], [60.0, 58.0])


JITTER = 2e-3 * (np.random.default_rng(1).random(TIME.size) > 0.5)


@pytest.mark.parametrize(
    ("displacement", "force", "says"),
    [
        (DOWN, 60.0 - DOWN,
         ("its displacement only falls, from 60 to 58 mm, while the force rises",
          "its value at first contact minus each value")),
        (DOWN - 58.0, DOWN - 58.0,
         ("only falls, from 2 to 0 mm, and the force falls with it",
          "add the rows of the loading before it",
          "multiply displacement and force by -1 if this is the loading")),
        (2.0 + JITTER, np.exp(-TIME / 5.0),
         ("its displacement changes by 0.002 mm only",
          "add the rows of the ramp before this hold, or delete the test")),
    ],
    ids=["turned over", "unloading alone", "hold alone"],
)  # fmt: skip
def test_a_test_without_a_ramp_is_refused_with_its_remedy(displacement, force, says):
    noise = 1e-3 * np.random.default_rng(0).standard_normal(TIME.size)
    with pytest.raises(InputError) as caught:
        made_ready(Test("slow", "p", TIME, displacement, force + noise))
    text = str(caught.value)
    assert text.startswith("test slow of pad p holds no loading ramp: ")
    assert "\n" not in text
    assert all(words in text for words in says)
