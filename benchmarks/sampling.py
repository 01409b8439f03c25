"""Effective samples a second: the toolkit against a plain numpy and emcee script."""

import time

import emcee
import numpy as np
from rivals import NumpyPosterior

from qlvbayes import Choices, Settings, read_study
from qlvbayes.fitting import compiled
from qlvbayes.fitting.ensemble import autocorrelation_time, sample
from qlvbayes.fitting.fit import build_posterior
from qlvbayes.fitting.optimum import starting_point
from qlvbayes.motion.experiment import prepare

RIVAL_STEPS = 500


def compare(seed=0):
    """(ours ESS/s, rival ESS/s, largest difference of the log densities up to a constant)."""
    experiment = prepare(read_study("data/pads.csv").pad("B"))
    choices = Choices(noise="correlated")  # as the rival's
    posterior = build_posterior(experiment, choices, experiment.with_role("fit"))
    rng = np.random.default_rng(seed)
    start = starting_point(posterior, experiment.floor, rng).normal
    rival = NumpyPosterior(posterior.record, experiment.scales)
    thetas = start.draw(32, rng)
    difference = np.array([rival(x) for x in thetas]) - np.asarray(
        compiled.log_densities(posterior, thetas)
    )
    sample(posterior, start, Settings(max_steps=400, seed=seed))  # compiles
    began = time.perf_counter()
    chain = sample(posterior, start, Settings(seed=seed))
    ours = chain.log_density.size / chain.autocorrelation / (time.perf_counter() - began)
    return ours, _rival(rival, thetas, seed), float(np.ptp(difference))


def _rival(rival, thetas, seed):
    sampler = emcee.EnsembleSampler(len(thetas), thetas.shape[1], rival)
    sampler.random_state = np.random.RandomState(seed).get_state()
    began = time.perf_counter()
    sampler.run_mcmc(thetas, RIVAL_STEPS)
    taken = time.perf_counter() - began
    return RIVAL_STEPS * len(thetas) / autocorrelation_time(sampler.get_chain()) / taken
