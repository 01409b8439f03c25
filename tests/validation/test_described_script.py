"""The studies of described laws: what they hide, and a law that predicts fresh tests."""

from __future__ import annotations

import described
import numpy as np
import pytest
from described_pads import BLOCK, OUTSIDERS, item, make_study

from qlvbayes.diagnosis.checks.outcome import SearchOutcome
from qlvbayes.diagnosis.description.describe import describe
from qlvbayes.diagnosis.searchsetup import build_search, protocol_of
from qlvbayes.effects.catalogue import EVERY
from qlvbayes.io.runtime import one_blas_thread
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare

SEED, SWELLING = 5, 5  # of a study whose pad stiffens while a test lasts
NOTHING = 3  # of one that hides nothing


def test_outsiders_come_equally_often_and_fresh_tests_are_others():
    seen = [item(SEED, k) for k in range(2 * len(BLOCK))]
    hidden = [name for scene, name, _ in seen if scene == "outsider"]
    assert sorted(hidden) == sorted(OUTSIDERS)
    assert not set(OUTSIDERS) & {kind.name for kind in EVERY}
    assert {paper for *_, paper in seen} == {True, False}
    study = make_study(SEED, SWELLING)
    depths = {round(float(test.displacement.max()), 2) for test in study.pad.tests}
    fresh = [round(float(test.displacement.max()), 2) for test in study.fresh]
    assert not depths & set(fresh)
    assert min(one.start_s for one in study.fresh) > max(one.start_s for one in study.pad.tests)


def _law_of(index: int):
    study = make_study(SEED, index)
    experiment = prepare(study.pad)
    with one_blas_thread():
        search = build_search(experiment, Choices())
        search.begin()
        outcome = SearchOutcome(experiment, search)
        protocol = protocol_of(experiment, bonded=False)
        return study, describe(outcome, frozenset(), protocol, lambda text: None)


@pytest.mark.slow
def test_a_law_of_the_plain_model_predicts_fresh_tests() -> None:
    study, law = _law_of(SWELLING)
    assert law.record is not None
    assert law.record.heldout_after < 0.6 * law.record.heldout_before
    before, after = (described.fresh_error(study, one) for one in (law.before, law.after))
    assert after < 0.6 * before
    assert law.record.parameters["k" if "k" in law.record.parameters else "k1"].sd > 0.0


def test_cases_are_counted_by_scene_and_fresh_tests_have_no_noise():
    case = {"scene": "outsider", "verdict": "unexplained", "law": "x", "fresh": [1.0, 0.4]}
    cases = [
        case,
        case | {"fresh": [1.0, 1.1]},
        case | {"law": None, "fresh": [1.0], "verdict": "adequate"},
        case | {"scene": "none", "law": None, "fresh": [], "verdict": "adequate"},
    ]
    found = {words: (rate.hits, rate.n) for words, (rate, _) in described.rates(cases).items()}
    assert list(found.values()) == [(2, 3), (2, 3), (1, 3), (1, 3), (0, 1), (0, 0)]
    study = make_study(SEED, NOTHING)
    last = study.fresh[0].force[-20:]
    assert np.ptp(np.diff(last, 2)) < 0.01 * study.noise
