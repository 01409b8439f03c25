"""Draws of a model's priors."""

import numpy as np
from scipy.stats import kstest
from support.endtoend import experiment

from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import draw_priors


def test_prior_draws_are_of_the_prior():
    model, _ = Choices().build(experiment().scales)
    draws = draw_priors(model, 400, np.random.default_rng(0))
    assert draws.shape == (400, 6)
    m = model.elastic.m
    standard = (draws[:, 0] - float(m.log_median)) / float(m.log_sd)
    assert kstest(standard, "norm").pvalue > 1e-3
