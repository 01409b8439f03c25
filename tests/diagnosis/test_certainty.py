"""Certainty: its features, its weights and what they rest on."""

import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from qlvbayes.diagnosis.certainty import FEATURES, LEAST, calibration, certainty, features

ROOT = Path(__file__).parents[2]
NOISE = 0.01


def step(effects, rmse, heldout, p=0.5):
    return SimpleNamespace(effects=effects, rmse=rmse, heldout_rmse=heldout, p_value=p)


def answer(rmse=0.011, heldout=0.011, p=0.5, before=0.04):
    return [step((), 0.03, before), step(("drag",), rmse, heldout, p)]


def test_features_are_what_they_are_called():
    x = features("drag", 50.0, answer(p=0.001), NOISE)
    assert len(x) == len(FEATURES)
    assert np.allclose(x, [math.asinh(50.0), math.log(0.04 / 0.011), math.log(1.1), 1.0])
    besides = features("lag", 50.0, answer(), NOISE)
    assert besides[1] == 0.0  # it is not in the answer
    alone = features("drag", 50.0, [step((), 0.03, None), step(("drag",), 0.011, None)], NOISE)
    assert alone[1] == 0.0  # there is one test only


def test_more_evidence_and_better_predictions_are_surer_and_what_is_left_is_a_doubt():
    def sure(factor=20.0, **changes):
        return certainty("drag", 0.99, factor, answer(**changes), NOISE)

    assert sure(factor=100.0) > sure(factor=5.0)
    assert sure(before=0.06) > sure(before=0.012)
    assert sure(p=0.0) < sure(p=0.5)
    assert sure(rmse=0.03) < sure(rmse=0.011)


@pytest.mark.parametrize(
    ("probability", "factor", "before"),
    [(0.5 * LEAST, 20.0, 0.04), (0.99, None, 0.04), (0.99, 20.0, 40.0)],
    ids=["hardly likely", "nothing to compare with", "beyond all studies"],
)
def test_what_no_study_showed_has_no_certainty(probability, factor, before):
    assert certainty("drag", probability, factor, answer(before=before), NOISE) is None


def test_the_weights_are_those_that_the_published_studies_give(tmp_path):
    """The script, run again on what is published, leaves the file that the package has."""
    known = calibration()
    script = f"""
import sys, json
sys.path.insert(0, {str(ROOT / "validation")!r})
import certainty as learning
names = []
for run in {list(known.runs)}:
    names += learning.names_of(run, learning.seen_cases(run))
x, there = learning.columns(names)
found = learning.bins(learning.left_out(names), there)
print(json.dumps([learning.learnt(x, there).tolist(), len(names), [row[:4] for row in found]]))
"""
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    weights, names, bins = json.loads(run.stdout)
    assert np.allclose(weights, known.weights, rtol=1e-6)
    assert names == known.names
    assert [tuple(one) for one in bins] == list(known.bins)


def test_certainty_is_calibrated_on_studies_that_it_was_not_learnt_from():
    """In no bin is the share that was there farther from the bin than chance allows (3 sd)."""
    for low, high, count, there in calibration().bins:
        middle = 0.5 * (low + high)
        spread = math.sqrt(middle * (1.0 - middle) / count)
        assert low - 3.0 * spread < there / count < high + 3.0 * spread
