"""Certainty: its features, its weights and what they rest on."""

import math

import certainty as learning
import numpy as np
import pytest
from msgspec import structs

from qlvbayes.diagnosis.certainty import FEATURES, LEAST, calibration, certainty, features
from qlvbayes.diagnosis.result import Strengths, Support

SUPPORT = Support(1.0, 3.0, 0.1, 0.2, 0.5, effects=1)


def test_features_are_what_they_are_called_and_each_makes_surer_or_less_sure():
    x = features(50.0, SUPPORT)
    assert len(x) == len(FEATURES)
    assert np.allclose(x, [math.asinh(50.0), 1.0, 3.0, 0.2, 0.0, 1.0])
    surely = features(50.0, structs.replace(SUPPORT, heldout_sds=40.0, p_left=0.001))
    assert (surely[2], surely[4]) == (5.0, 1.0)
    assert certainty(0.99, 100.0, SUPPORT) > certainty(0.99, 5.0, SUPPORT)
    for name, less, more in (
        ("heldout_gain", 0.1, 1.5), ("heldout_sds", 0.5, 4.0), ("effects", 3, 1),
        ("p_left", 0.0, 0.5), ("error_left", 1.0, 0.1),
    ):  # fmt: skip
        low, high = (
            certainty(0.99, 20.0, structs.replace(SUPPORT, **{name: x})) for x in (less, more)
        )
        assert low < high, name


@pytest.mark.parametrize(
    ("probability", "factor", "own"),
    [(0.5 * LEAST, 20.0, SUPPORT), (0.99, None, SUPPORT), (0.99, 20.0, None)],
    ids=["hardly likely", "nothing to compare with", "no support"],
)
def test_what_no_study_showed_has_no_certainty(probability, factor, own):
    assert certainty(probability, factor, own) is None


def test_certainty_ends_with_the_studies_and_falls_with_disagreement():
    far = certainty(0.99, 20.0, structs.replace(SUPPORT, heldout_gain=40.0))
    end = certainty(0.99, 20.0, structs.replace(SUPPORT, heldout_gain=calibration().high[1]))
    assert far == end
    whole, half = (
        structs.replace(SUPPORT, strengths=Strengths(spread=0.1, agreement=one, parts=()))
        for one in (1.0, 0.5)
    )
    assert certainty(0.99, 20.0, half) == pytest.approx(0.5 * certainty(0.99, 20.0, whole))


def test_the_weights_are_those_that_the_published_studies_give():
    """The script, run again on what is published, leaves the file that the package has."""
    known = calibration()
    learnt = learning.weights_of(list(known.runs))
    assert np.allclose(learnt["weights"], known.weights, rtol=1e-6)
    assert learnt["names"] == known.names
    assert [tuple(one) for one in learnt["bins"]] == list(known.bins)


def test_certainty_is_calibrated_on_studies_that_it_was_not_learnt_from():
    """In no bin is the share that was there farther from the bin than chance allows (3 sd)."""
    for low, high, count, there in calibration().bins:
        middle = 0.5 * (low + high)
        spread = math.sqrt(middle * (1.0 - middle) / count)
        assert low - 3.0 * spread < there / count < high + 3.0 * spread
