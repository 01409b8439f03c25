"""The log density of a fit on the reduced record of six tests."""

import numpy as np
from timing import call_ms

from qlvbayes import Choices, read_study
from qlvbayes.fitting.optimum import find_start
from qlvbayes.motion.experiment import prepare

WALKERS = (1, 32, 1024)


def rows():
    """(noise, walkers, density ms) for each noise model."""
    experiment = prepare(read_study("data/pads.csv").pad("B"), all_tests=True)
    found = []
    for noise in ("white", "floor"):
        start = find_start(experiment, Choices(noise=noise), experiment.trials)
        posterior, rng = start.posterior, np.random.default_rng(0)
        for walkers in WALKERS:
            thetas = start.normal.draw(walkers, rng)
            found.append((noise, walkers, call_ms(posterior.log_density, thetas, repeats=7)))
    return found, posterior.record.motion.time.shape, posterior.record.blocks.force.shape
