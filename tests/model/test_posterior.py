"""Draws of a posterior's priors."""

import numpy as np
from qlvbayes.model.posterior import draw_priors
from scipy.stats import kstest
from support.endtoend import experiment

from qlvbayes.fitting.fit import build_posterior
from qlvbayes.model.choices import Choices


def test_prior_draws_are_of_the_prior():
    posterior = build_posterior(experiment(), Choices(), experiment().with_role("fit"))
    draws = draw_priors(posterior, 400, np.random.default_rng(0))
    assert draws.shape == (400, posterior.size)
    m = posterior.model.elastic.m
    standard = (draws[:, 0] - float(m.log_median)) / float(m.log_sd)
    assert kstest(standard, "norm").pvalue > 1e-3
