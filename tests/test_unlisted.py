"""Rivals that no list holds: a spring with a kink, offsets of the tests."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_pads import hidden_pad
from scipy.stats import norm

from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.freespring import KinkedSpring
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.synthetic import HIDDEN, OUTSIDE, PAPER_RATES, full_retraction_protocol

pytestmark = pytest.mark.slow  # whole diagnoses

STIFFNESS, DEPTH = 0.35, 0.9  # N/mm, mm


@pytest.fixture(scope="module")
def retracted():
    """A second spring met at depth, in tests that lose contact on their way back."""
    spring = OUTSIDE["second_contact"](stiffness=STIFFNESS, depth=DEPTH)
    rates = (1.0, 10.0, 20.0)
    return diagnose(hidden_pad(spring, rates=rates, protocol=full_retraction_protocol))


@pytest.fixture(scope="module")
def jump():
    """Something in the rig gives way between the third test and the fourth."""
    shift = OUTSIDE["slow_creep_jump"](offset=-0.06, begin=280.0, time=15.0)
    return diagnose(hidden_pad(shift, rates=PAPER_RATES))


def test_a_second_contact_is_outside_the_list_also_where_contact_is_lost(retracted):
    assert retracted.verdict == "unexplained"
    assert retracted.not_ruled_out == ()


def test_the_kink_is_found_where_the_second_contact_is(retracted):
    work = retracted.work
    spring = KinkedSpring(work.experiment, work.ensemble, work.ensemble.subset())
    top = spring.highest(work.path.steps[0].point, -np.inf)
    scales, place = work.experiment.scales, norm.cdf(top.theta[-1])
    assert place * scales.depth == pytest.approx(DEPTH, abs=0.05)
    assert top.theta[-2] * scales.force / scales.depth == pytest.approx(STIFFNESS, rel=0.2)
    # as good as the noise: no part of the second contact is left
    assert np.hypot(*top.constants[-3:-1]) < 1.2 * work.experiment.floor.total


def test_spring_and_pad_lose_contact_together(retracted):
    work = retracted.work
    spring = KinkedSpring(work.experiment, work.ensemble, work.ensemble.subset())
    plain = work.path.steps[0].point
    still = np.zeros((1, plain.constants.size))
    coefficients = np.array([0.0, 0.0, 0.0, 0.2, norm.ppf(0.5)])
    with_it, _ = spring.combine(plain.constants, still, coefficients)
    without, _ = spring.combine(plain.constants, still, np.zeros(5))
    depth = spring.places[0]
    lost = (without == 0.0) & (depth > 0.5)
    beyond = 0.2 * (depth - 0.5) * work.experiment.scales.force
    assert lost.any()
    assert np.all(with_it[lost] < beyond[lost])
    touched = without > 0.0
    np.testing.assert_allclose(
        (with_it - without)[touched], np.maximum(beyond, 0.0)[touched], atol=1e-12
    )


def test_a_jump_in_the_middle_of_a_study_is_no_drift(jump):
    assert jump.verdict == "unexplained"
    assert jump.effects == ()


def test_the_words_say_what_explains_the_tests_better(jump):
    assert jump.outside == "free_offsets"
    assert jump.unlisted["free_offsets"] > Settings().unlisted
    assert "An offset of its own in every test" in paragraphs(jump)[0]
    told = {entry["rival"]: entry["log_bayes_factor"] for entry in jump.as_dict()["unlisted"]}
    assert told == jump.unlisted


def test_what_only_imitates_is_said_to(jump):
    sound = replace(jump, stages=(jump.stages[0], replace(jump.stages[-1], sound=True)))
    first = paragraphs(sound)[0]
    assert "something outside the list is likelier: none is named" in first
    assert "An offset of its own in every test" in first


def test_a_steady_drift_beats_an_offset_of_its_own_in_every_test():
    found = diagnose(hidden_pad(HIDDEN["force_drift"](rate=1e-4), rates=PAPER_RATES))
    assert found.effects == ("force_drift",)
    assert found.unlisted["free_offsets"] < 0.0
