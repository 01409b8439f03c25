"""Fits against least squares: the checks on numbers, and least squares on one simulated pad."""

import numpy as np
import pytest
from blind.study import make_study
from budget import MOST, by_fit, least_squares, paired, rises
from registration import Registration

from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.inference.modes import find_mode
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare


def test_errors_that_rise_and_falls_over_the_tests():
    assert rises([0.3, 0.2, 0.2, 0.1]) == []
    assert rises([0.1, 0.2, 0.05, 0.06]) == pytest.approx([2.0, 1.2])
    fall, error = paired(np.array([2.0, 12.0, 7.0]), np.array([1.0, 10.0, 4.0]))
    assert fall == pytest.approx(2.0)
    assert error == pytest.approx(1.0 / np.sqrt(3.0))
    assert paired(np.ones(1), np.ones(1)) == (None, None)


def test_least_squares_leaves_least_whatever_it_begins_from():
    """From a fit that is far off, the same as from the fit under coarse noise."""
    search = build_search(prepare(make_study(Registration.read("bounds").population, 283).pad))
    density, plain = search.density, search.baseline
    observed, real = np.asarray(density.space.record.blocks.force), density.space.real

    def rms(point):
        return float(np.sqrt(np.mean((observed - point.predicted)[real] ** 2)))

    fit = find_mode(density.coarse, plain, density.space.prior_draws(plain)[0]).point
    own = density.space.parameters(plain)
    far = density.at(plain, own.within(fit.theta + 0.3 * own.length))
    least = least_squares(density, fit, rms(fit))
    assert least <= rms(fit) < rms(far) / MOST
    assert least_squares(density, far, rms(far)) == pytest.approx(least, rel=0.01)
    experiment = prepare(make_study(Registration.read("bounds").population, 283).pad)
    found = by_fit(experiment, Choices())
    assert found["ratio"] == found["rms_N"] / found["least_N"] >= 1.0
    assert 0.0 < found["least_N"] < 0.1 * experiment.scales.force
