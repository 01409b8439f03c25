"""Effects that act by the same constants everywhere, and what only looks like them."""

import math

import numpy as np
import pytest
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.candidate import candidate_at
from qlvbayes.diagnosis.checks.constancy import log_bayes_factor, log_odds_of_varying
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import Imitation
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import find_mode
from qlvbayes.io.data import Pad
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import HIDDEN

IMITATION = Imitation()
MOST = math.log(IMITATION.odds)
RATES = (1.0, 5.0, 20.0, 100.0)  # mm/s
DRAG = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))


def pad_with_drags(etas, seed=0):
    """One test at each rate, each with a drag of its own (N s/mm)."""
    drags = {eta: HIDDEN["viscous_drag"](eta=eta) for eta in etas}
    pads = {eta: hidden_pad(drag, rates=RATES, seed=seed) for eta, drag in drags.items()}
    tests = tuple(pads[eta].trials[k].test for k, eta in enumerate(etas))
    return prepare(Pad("B", tests, PAD))


def log_odds(etas, seed=0):
    experiment = pad_with_drags(etas, seed)
    search = build_search(experiment, kinds=FEW)
    density, space = search.density, search.density.space
    start = np.median(space.prior_draws(DRAG), axis=0)
    mode = find_mode(density, DRAG, start)
    found = candidate_at(density, DRAG, mode, search.settings.tolerance)
    return log_odds_of_varying(
        density, Samples.from_experiment(experiment, space), found, "viscous_drag", IMITATION
    )


@pytest.mark.parametrize("eta", [0.0005, 0.004])
def test_a_true_effect_acts_with_one_strength(eta):
    """The smaller one adds 4 % of the peak force in the fastest test, next to nothing elsewhere."""
    assert np.mean([log_odds([eta] * 4, seed) for seed in range(3)]) < 0.5 * math.log(
        Imitation().odds
    )


def test_a_drag_that_every_test_would_need_another_of_is_none():
    assert log_odds([0.006, 0.002, 0.006, 0.002]) > MOST


def test_it_is_wrong_of_a_true_effect_in_one_of_twenty_at_most():
    """Markov's inequality, whatever the tests tell of the strengths."""
    rng = np.random.default_rng(5)
    for scale in (0.1, 3.0, 30.0, 1000.0):
        root = scale * rng.normal(size=(6, 4))
        draws = rng.normal(size=(4000, 6))
        found = [log_bayes_factor(root.T @ root, draw @ root, IMITATION) for draw in draws]
        assert np.mean(np.array(found) > MOST) < 0.05


def test_strengths_that_vary_are_seen_where_the_tests_tell_them():
    rng = np.random.default_rng(6)
    root = 30.0 * rng.normal(size=(6, 4))
    strengths = 0.3 * rng.normal(size=(400, 4))
    slopes = (rng.normal(size=(400, 6)) + strengths @ root.T) @ root
    found = [log_bayes_factor(root.T @ root, slope, IMITATION) for slope in slopes]
    assert np.mean(np.array(found) > MOST) > 0.8
