"""The strength of an effect in each test: what agrees, and what only looks like an effect."""

import numpy as np
import pytest
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.candidate import candidate_at
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.checks.strengths import agreement, pooled, strengths
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.settings import Imitation
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import find_mode
from qlvbayes.io.data import Pad
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import HIDDEN

RATES = (5.0, 10.0, 20.0, 40.0)  # mm/s
DRAG = Hypothesis("exponential", "prony:2", frozenset({"viscous_drag"}))


def found_strengths(etas):
    """One test at each rate, each with a drag of its own (N s/mm)."""
    pads = {eta: hidden_pad(HIDDEN["viscous_drag"](eta=eta), rates=RATES) for eta in etas}
    tests = tuple(pads[eta].trials[k].test for k, eta in enumerate(etas))
    experiment = prepare(Pad("B", tests, PAD))
    search = build_search(experiment, kinds=FEW)
    density, space = search.density, search.density.space
    mode = find_mode(density, DRAG, np.median(space.prior_draws(DRAG), axis=0))
    found = candidate_at(density, DRAG, mode, search.settings.tolerance)
    samples = Samples.from_experiment(experiment, space)
    return strengths(density, samples, found, "viscous_drag", Imitation())


def test_a_drag_of_one_strength_agrees_and_one_of_many_strengths_is_told():
    one = found_strengths([0.004] * 4)
    assert one.agreement > 0.95
    many = found_strengths([0.012, 0.002, 0.010, 0.004])
    assert many.spread > 0.2
    assert many.agreement < one.agreement
    low, high = many.range
    assert high > 1.5 * low
    assert [part.test for part in many.parts] == [part.test for part in one.parts]


@pytest.mark.parametrize(
    ("deviations", "expected"), [([0.0, 0.0], 1.0), ([1.0, -1.0], 0.5), ([3.0, -3.0], 0.1)]
)
def test_agreement_is_the_share_of_the_force_that_one_strength_makes(deviations, expected):
    share = agreement(np.ones(2), np.array(deviations))
    assert share == pytest.approx(expected)


def test_strengths_are_pooled_about_their_mean_whatever_the_mean_is():
    """A common factor is the amplitude's, not a scatter."""
    curvature, squares = np.eye(6) / 0.05**2, np.ones(6)
    scatter = np.array([0.3, -0.2, 0.1, -0.3, 0.2, -0.1])
    moved, sds, spread = pooled(curvature, curvature @ (scatter + 2.0), squares, Imitation())
    assert moved == pytest.approx(scatter, abs=0.05)
    assert np.all(sds < 0.06)
    assert 0.1 < spread < 0.5
    same, _, none = pooled(curvature, curvature @ np.full(6, 2.0), squares, Imitation())
    assert none == 0.0
    assert np.all(same == 0.0)
