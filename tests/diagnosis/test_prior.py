"""The prior over hypotheses: tables of numbers."""

import math
from itertools import combinations

import pytest

from qlvbayes.diagnosis.prior import Families, log_prior
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import EFFECTS, EVERY
from qlvbayes.inference.forward.hypothesis import Hypothesis

LAWS = (("x",), ("p",))
BASELINE = Hypothesis("x", "p")
# two families with forms, one without, and one that names nothing
FAMILIES = Families(
    {"a": "a", "a2": "a", "a3": "a", "b": "b", "b2": "b", "c": "c", "w": "w"}, frozenset({"w"})
)


def prior(effects, candidates=FAMILIES, baseline=BASELINE, settings=None):
    hypothesis = Hypothesis("x", "p", frozenset(effects))
    return math.exp(
        log_prior(hypothesis, baseline, LAWS, candidates, settings or DiagnosisSettings())
    )


def sets(names):
    return [some for size in range(len(names) + 1) for some in combinations(names, size)]


def test_prior_sums_to_one():
    settings, effects = DiagnosisSettings(complete=0.5, chosen_law=0.6), ("a", "b", "c")
    laws = (("x", "y", "z"), ("p", "q"))
    families = Families({name: name for name in effects})
    total = sum(
        math.exp(log_prior(Hypothesis(e, r, frozenset(some)), BASELINE, laws, families, settings))
        for e in laws[0]
        for r in laws[1]
        for some in sets(effects)
    )
    # sets of more effects than there are would hold the rest
    assert total == pytest.approx(1.0 - 0.5**4)
    total = sum(prior(some) for some in sets(FAMILIES.family_of))
    assert total == pytest.approx(1.0 - 0.5**5)


@pytest.mark.parametrize(
    ("effects", "probability"),
    [
        ((), 1 / 2),
        (("c",), 1 / 4 / 4),  # one of four families
        (("a",), 1 / 4 / 4 / 2),  # the listed law's half,
        (("a2",), 1 / 4 / 4 / 4),  # and two forms share the other
        (("b2",), 1 / 4 / 4 / 2),
        (("a", "b2"), 1 / 8 / 6 / 2 / 2),  # one of six pairs
        (("a3", "w"), 1 / 8 / 6 / 4),
        (("a", "a2"), 0.0),  # one family twice
    ],
)
def test_a_familys_members_share_its_probability(effects, probability):
    assert prior(effects) == pytest.approx(probability, rel=1e-12, abs=0.0)


def test_what_the_user_put_in_takes_its_family():
    baseline = Hypothesis("x", "p", frozenset({"a2"}))
    assert prior({"a2"}, baseline=baseline) == pytest.approx(1 / 2)
    assert prior({"a2", "c"}, baseline=baseline) == pytest.approx(1 / 4 / 3)
    assert prior({"a2", "a"}, baseline=baseline) == 0.0
    alone = Families({"a2": "a", "a3": "a", "c": "c"})
    assert prior({"a2"}, alone) == pytest.approx(1 / 4 / 2 / 2)


def test_families_follow_from_the_classes_and_are_counted():
    listed = Families.from_kinds(EFFECTS)
    for some in ((), ("friction",), ("friction", "inertia")):
        expected = 0.5 ** (len(some) + 1) / math.comb(len(EFFECTS), len(some))
        assert prior(some, listed) == pytest.approx(expected)
    families = Families.from_kinds(EVERY)
    forms = ["pressure_friction", "sharp_friction", "guide_friction"]
    assert families.members("friction") == ["friction", *forms]
    assert families.family_of["spreading_lag"] == "channel_lag"
    assert families.unmodelled == {"slow_change", "offsets_by_test"}
    assert families.forms_in({"pressure_friction", "inertia", "slow_change"}) == {
        "friction": "pressure_friction",
        "inertia": "inertia",
    }
