"""The sd of single samples under each noise model."""

import numpy as np

from qlvbayes.model.noise import Correlated, Floor, White
from qlvbayes.motion.record import Blocks


def test_sample_sd_is_that_of_a_single_sample():
    samples = Blocks.of_means(
        np.zeros(2), np.ones(2), np.arange(2.0), np.arange(2.0), np.array([1.0, 2.0])
    )
    correlated = np.hypot([0.3, 0.6], 0.4)
    assert np.allclose(White(0.4).sample_sd(samples), [0.4, 0.8])
    assert np.allclose(Correlated(0.3, 0.4, 1.0).sample_sd(samples), correlated)
    assert np.allclose(Floor(0.3, 0.4, 1.0, 2.0, 0.1).sample_sd(samples), 2.0 * correlated)
