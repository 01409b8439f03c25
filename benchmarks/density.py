"""The log density and its gradient on the reduced record of six tests."""

import jax
import jax.numpy as jnp
import numpy as np
from timing import call_ms

from qlvbayes import Choices, read_study
from qlvbayes.fitting import compiled
from qlvbayes.fitting.fit import build_posterior
from qlvbayes.fitting.optimum import starting_point
from qlvbayes.motion.experiment import prepare

WALKERS = (1, 32, 1024)


@jax.jit
def gradients(posterior, thetas):
    return jax.vmap(jax.grad(posterior.log_density))(thetas)


def rows():
    """(noise, walkers, density ms, gradient ms) for each noise model."""
    experiment = prepare(read_study("data/pads.csv").pad("B"), all_tests=True)
    found = []
    for noise in ("white", "correlated", "floor"):
        posterior = build_posterior(experiment, Choices(noise=noise), experiment.trials)
        rng = np.random.default_rng(0)
        start = starting_point(posterior, experiment.floor, rng).normal
        for walkers in WALKERS:
            thetas = jnp.asarray(start.draw(walkers, rng))
            found.append(
                (
                    noise,
                    walkers,
                    call_ms(compiled.log_densities, posterior, thetas, repeats=7),
                    call_ms(gradients, posterior, thetas, repeats=3),
                )
            )
    grid, blocks = posterior.record.motion.time.shape, posterior.record.blocks.force.shape
    return found, grid, blocks
