"""Where several effects explain the tests alike, the constants allow for each of them."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_pads import hidden_pad
from scipy.special import softmax

from qlvbayes.diagnosis.averaging import averaged, explanations_of
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.verdict import Estimate
from qlvbayes.diagnosis.words import paragraphs
from qlvbayes.synthetic import HIDDEN


@pytest.fixture(scope="module")
def either():
    """A drag seen at nearly one speed, by someone who wants more than 20 000 to 1 to be sure."""
    experiment = hidden_pad(HIDDEN["viscous_drag"](eta=0.003), rates=(20.0, 30.0))
    return diagnose(experiment, settings=Settings(apart=10.0))


def test_the_average_has_the_moments_of_the_mixture():
    rng = np.random.default_rng(0)
    logs = np.array([-1000.0, -1001.0])
    found = [{"m": Estimate("N/mm", 1.0, 0.1)}, {"m": Estimate("N/mm", 2.0, 0.3)}]
    weights = np.array([1.0, np.exp(-1.0)]) / (1.0 + np.exp(-1.0))
    which = rng.choice(2, 400_000, p=weights)
    draws = rng.normal(np.array([1.0, 2.0])[which], np.array([0.1, 0.3])[which])
    mixed = averaged(logs, found)["m"]
    assert mixed.unit == "N/mm"
    assert mixed.mean == pytest.approx(draws.mean(), abs=0.005)
    assert mixed.sd == pytest.approx(draws.std(), abs=0.005)


def test_one_explanation_is_its_own_average():
    alone = {"m": Estimate("N/mm", 0.3, 0.01), "b": Estimate("1/mm", 1.1, 0.02)}
    found = averaged([-50.0], [alone])
    assert {n: (e.mean, e.sd) for n, e in found.items()} == {
        n: (e.mean, pytest.approx(e.sd)) for n, e in alone.items()
    }


def test_rivals_make_the_verdict_ambiguous_and_a_further_test_is_suggested(either):
    assert either.verdict == "ambiguous"
    assert {"viscous_drag", "power_law_drag"} <= set(either.group)
    assert either.suggestions
    assert either.suggestions[0].evidence > 0.0


def test_constants_lie_between_the_rivals_and_are_less_sure(either):
    last = either.stages[-1].parameters
    assert set(either.constants) == {name for name in last if "." not in name}
    weights = [np.exp(r.log_bayes_factor) for r in either.ranking if r.effect in either.group]
    for name, found in either.constants.items():
        # of one explanation alone, the share of its weight is the least that its variance keeps
        assert found.sd >= last[name].sd * np.sqrt(max(weights) / sum(weights)) * 0.99


def test_explanations_out_of_the_window_have_no_part(either):
    work = either.work
    wide, narrow = (
        explanations_of(
            work.experiment, work.ensemble, work.path, Settings(apart=0.0, window=window)
        )
        for window in (10.0, 0.01)
    )
    assert [one.log_odds for one in narrow] == [0.0]
    assert len(wide) > 1
    assert all(-10.0 < one.log_odds <= 0.0 for one in wide)
    for one in wide:
        gain = one.point.log_evidence - wide[0].point.log_evidence
        assert one.log_odds == pytest.approx(gain, abs=3.0)


def test_words_and_json_give_the_averaged_constants(either):
    first = paragraphs(either)[0]
    m = either.constants["m"]
    assert f"Allowing for all that the tests do not rule out, m = {m}" in first
    assert either.as_dict()["constants"]["m"] == {"unit": "N/mm", "mean": m.mean, "sd": m.sd}


def test_all_that_the_tests_leave_is_listed(either):
    """The likeliest first, with what each has among all that are left."""
    listed, work = either.not_ruled_out, either.work
    left = explanations_of(work.experiment, work.ensemble, work.path, Settings())
    shares = sorted(softmax([one.log_odds for one in left]), reverse=True)
    assert [one.probability for one in listed] == pytest.approx(shares[: Settings().listed])
    assert ("viscous_drag",) in [one.effects for one in listed]
    told = either.as_dict()["not_ruled_out"]
    assert [(tuple(t["effects"]), t["probability"]) for t in told] == [
        (one.effects, one.probability) for one in listed
    ]


def test_what_is_not_ruled_out_is_told_beside_the_name(either):
    beside = replace(either, verdict="missing_effect", group=("viscous_drag",))
    said = " ".join(paragraphs(beside))
    for one in either.not_ruled_out:
        if one.effects not in ((), ("viscous_drag",)):
            assert f"{one.effects[0]} (" in said.partition("do not rule out")[2]


def test_explanations_beyond_those_listed_are_told_together(either):
    first, *_ = either.not_ruled_out
    beside = replace(
        either, verdict="missing_effect", group=("viscous_drag",), effects=("friction",)
    )
    alone = replace(beside, not_ruled_out=(replace(first, probability=0.83),))
    assert "or others (17 % together)" in " ".join(paragraphs(alone))
    certain = replace(beside, not_ruled_out=(replace(first, probability=1.0),))
    assert "others" not in " ".join(paragraphs(certain))


def test_no_more_than_so_many_explanations_are_listed():
    one = diagnose(hidden_pad(rates=(1.0, 20.0)), settings=Settings(listed=1))
    assert one.verdict == "adequate"
    assert len(one.not_ruled_out) == 1
    assert one.not_ruled_out[0].probability < 1.0


def test_where_nothing_is_named_nothing_is_one_of_the_explanations():
    found = diagnose(hidden_pad(rates=(1.0, 20.0)))
    assert found.verdict == "adequate"
    assert () in [one.effects for one in found.not_ruled_out]
