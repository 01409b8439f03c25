"""The verdict as a function of numbers: priors, probabilities and certainty in, words out."""

import math
from itertools import combinations, product
from types import SimpleNamespace

import certainty as learning
import numpy as np
import pytest
from msgspec import structs

from qlvbayes.diagnosis.certainty import FEATURES, LEAST, calibration, certainty, features
from qlvbayes.diagnosis.decision import (
    Weight,
    decide,
    decide_with_support,
    ignore_unmodelled,
    one_of,
    refusals,
    require,
    restrict_to,
)
from qlvbayes.diagnosis.prior import Families, log_prior
from qlvbayes.diagnosis.result import Ranked, Strength, Strengths, Support
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.diagnosis.summary.summarizing import unlikely_over_all
from qlvbayes.effects.catalogue import EFFECTS, EVERY
from qlvbayes.inference.forward.hypothesis import Hypothesis

EXP = ("exponential", "prony:2")
HERTZ = ("hertz", "prony:2")


def weight(effects, probability, *, base=EXP, unmodelled=0.0):
    return Weight(base, frozenset(effects.split()), float(np.log(probability)), unmodelled)


def left(weights):
    """The decision where every hypothesis leaves structure that matters."""
    sure = [ranked(name) for name in decide(weights).inclusion]
    found, _ = decide_with_support(
        weights, sure, DiagnosisSettings(), adequate=lambda index: False, supported=never
    )
    return found


def never(one, index):
    raise AssertionError


def required(name):
    return lambda weights: decide(require(weights, {name}))


def within_names(names):
    return lambda weights: decide(restrict_to(weights, set(names.split())))


MEASURED = {"drag": 0.9, "adhesion": 0.1, "adhesion drag": 1e-6}


@pytest.mark.parametrize(
    ("decided", "weights", "verdict", "effects", "group"),
    [
        (decide, {"": 0.97, "friction": 0.03}, "adequate", "", ""),
        # no hypothesis alone has 0.9, the effect has it over all its companions
        (decide, {"drag": 0.5, "drag film": 0.3, "drag leak": 0.15, "": 0.05}, "missing_effect",
         "drag", ""),
        (decide, {"drag": 0.55, "film": 0.43, "": 0.02}, "ambiguous", "", "drag film"),
        # a group may stand beside a named effect
        (decide, {"inertia drag": 0.6, "inertia film": 0.38, "": 0.02}, "ambiguous", "inertia",
         "drag film"),
        # structure is left beside what is named or not
        (left, {"": 0.6, "drag": 0.4}, "unexplained", "", ""),
        (left, {"drag": 0.99, "": 0.01}, "partly_explained", "drag", ""),
        # what is measured is in every hypothesis that counts, unless no hypothesis has it
        (required("adhesion"), MEASURED, "missing_effect", "adhesion", ""),
        (required("inertia"), MEASURED, "missing_effect", "drag", ""),
        # what is likely only beside a refused effect is not named, nor anything in its place
        (within_names(""), {"film": 0.9, "lag": 0.06, "": 0.04}, "adequate", "", ""),
    ],
)  # fmt: skip
def test_the_verdict_follows_from_the_probabilities(decided, weights, verdict, effects, group):
    weights = [weight(names, p) for names, p in weights.items()]
    found = decided(weights)
    assert found.verdict == verdict
    assert (set(found.effects), set(found.group)) == (set(effects.split()), set(group.split()))
    assert group or weights[found.selected].effects >= set(found.effects)
    assert sum(found.base.values()) == pytest.approx(1.0)


def test_what_stands_for_the_answer_beside_something_outside_and_noise():
    found = decide([weight("drag", 0.98, unmodelled=0.99), weight("", 0.02, unmodelled=1.0)])
    assert (found.verdict, found.effects) == ("partly_explained", ("drag",))
    weights = [weight("drag leak", 0.4), weight("drag", 0.35), weight("drag set", 0.25)]
    assert weights[decide(weights).selected].effects == {"drag"}
    weights = [weight("drag", 0.98, unmodelled=0.7), weight("", 0.02, unmodelled=0.9)]
    assert decide(weights).unmodelled == pytest.approx(0.98 * 0.7 + 0.02 * 0.9)
    found = decide(ignore_unmodelled(weights))
    assert (found.verdict, found.effects) == ("missing_effect", ("drag",))


def test_of_effects_that_look_alike_one_is_there_however_probable_each_is():
    both = decide([weight("set softening drag", 0.97), weight("set drag", 0.03)])
    found = one_of(both, ("set", "softening", "play"), 3)
    assert (found.verdict, found.effects) == ("ambiguous", ("drag",))
    assert set(found.group) == {"set", "softening"}
    assert found.selected == both.selected
    alone = decide([weight("set drag", 1.0)])
    assert one_of(alone, ("set", "softening"), 3) == alone


def test_a_law_that_names_nothing_is_outside_unless_the_listed_ones_do():
    free = Weight(("spline", "prony:2"), frozenset({"drag"}), 0.0, 0.0, nameable=False)
    weights = [free, weight("drag", 1e-9), weight("", 1e-12)]
    found = decide(weights)
    assert (found.verdict, found.effects) == ("partly_explained", ("drag",))
    assert found.unmodelled == pytest.approx(1.0)
    found = decide(ignore_unmodelled(weights))
    assert (found.verdict, found.effects) == ("missing_effect", ("drag",))
    assert weights[found.selected].base == EXP


def ranked(name, *, inclusion=0.99, certainty=0.9, gain=1.0, agreement=1.0, heldout=0.1):
    strengths = Strengths(0.1, agreement, (Strength("slow", 0.5, 0.1, 1.0),))
    own = Support(gain, 5.0, heldout, 0.1, 0.5, effects=1, strengths=strengths)
    return Ranked(name, inclusion, inclusion, 9.0, 0.1, {}, support=own, certainty=certainty)


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        (ranked("drag"), None),
        (ranked("drag", certainty=0.3, gain=-0.2), "tests left out are predicted worse"),
        (ranked("drag", certainty=0.3), "there in 30 %"),
        (ranked("drag", certainty=0.3, agreement=0.35), "something else looks like it"),
        (ranked("drag", certainty=0.0, heldout=None), "adds no force"),
        (ranked("drag", inclusion=0.1), "over all hypotheses its probability is 10 %"),
    ],
)
def test_an_effect_is_named_if_its_certainty_is_enough(entry, reason):
    decision = decide([weight("drag", 1.0)])
    found = refusals(decision, {"drag": entry}, DiagnosisSettings())
    assert (reason is None and not found) or reason in found["drag"]


def test_a_group_keeps_members_of_little_certainty_and_loses_those_that_predict_worse():
    decision = decide([weight("drag", 0.55), weight("film", 0.43), weight("", 0.02)])
    assert decision.tried == ("drag",)
    unsure = {"drag": ranked("drag", inclusion=0.55, certainty=0.3)}
    assert refusals(decision, unsure, DiagnosisSettings()) == {}
    worse = {"drag": ranked("drag", inclusion=0.55, certainty=0.3, gain=-0.1)}
    assert list(refusals(decision, worse, DiagnosisSettings())) == ["drag"]


def over_all(weights):
    inclusion = decide(weights).inclusion.__getitem__
    return SimpleNamespace(
        inclusion=inclusion, search=SimpleNamespace(settings=DiagnosisSettings())
    )


def test_what_lacks_support_is_refused_and_what_stays_says_how_likely_it_is_over_all():
    """The support of what stays is measured anew, in the hypothesis that is left."""
    table = {"drag film lag": 0.5, "drag film": 0.45, "film": 0.02, "drag": 0.0295, "": 0.0005}
    weights, measured = [weight(names, p) for names, p in table.items()], []
    ranking = [ranked("drag"), ranked("film", certainty=0.3), ranked("lag", certainty=0.2)]

    def supported(one, index):
        measured.append((one.effect, weights[index].effects))
        return one

    found, told = decide_with_support(
        weights, ranking, DiagnosisSettings(), adequate=lambda index: True, supported=supported
    )
    assert (found.verdict, found.effects) == ("missing_effect", ("drag",))
    assert list(found.refused) == ["film"]
    assert measured == [("drag", {"drag"})]
    assert list(told) == ranking
    assert not unlikely_over_all(over_all(weights), found)
    free = Weight(("spline", "prony:2"), frozenset({"drag"}), 0.0, 0.0, nameable=False)
    weights = [free, weight("drag film", 1e-9), weight("drag", 1e-13)]
    inside = decide(ignore_unmodelled(weights))
    (notice,) = unlikely_over_all(over_all(weights), inside)
    assert notice.startswith("film is named after")


def test_the_base_told_is_likely_without_what_is_refused():
    of_hertz = [("film lag", 0.98), ("film leak", 0.0195), ("film", 0.0001)]
    weights = [weight("film", 0.0004), *(weight(*one, base=HERTZ) for one in of_hertz)]
    found = decide(restrict_to(weights, {"film"}))
    assert weights[found.selected].base == EXP
    assert found.base == pytest.approx({EXP: 0.8, HERTZ: 0.2})


FAMILIES = Families(
    {"friction": "friction", "coulomb": "friction", "lag": "lag", "filter": "lag",
     "wander": "wander"},
    frozenset({"wander"}),
)  # fmt: skip


def within(*weights):
    return [one.within(FAMILIES) for one in weights]


def test_an_effect_is_named_by_its_family_and_its_forms_are_no_group():
    """Neither form alone has 0.9, the effect has; the likelier form is reported."""
    shares = {
        "coulomb": 0.5, "friction": 0.2, "friction filter": 0.15, "coulomb lag": 0.1, "": 0.05
    }  # fmt: skip
    weights = within(*(weight(names, p) for names, p in shares.items()))
    found = decide(weights)
    assert (found.verdict, found.effects, found.group) == ("missing_effect", ("friction",), ())
    assert found.inclusion == pytest.approx({"friction": 0.95, "lag": 0.25})
    assert weights[found.selected].forms == {"friction": "coulomb"}
    found = decide(within(weight("coulomb", 0.5), weight("filter", 0.49), weight("", 0.01)))
    assert (found.verdict, found.group) == ("ambiguous", ("friction", "lag"))


def test_what_names_nothing_is_outside_and_what_raises_the_error_is_not_named():
    weights = within(weight("wander", 0.98), weight("", 0.02))
    found = decide(weights)
    assert (found.verdict, found.effects, found.inclusion) == ("unexplained", (), {})
    assert found.unmodelled == pytest.approx(0.98)
    weights = within(weight("wander coulomb", 0.6), weight("coulomb", 0.38), weight("", 0.02))
    found = decide(weights)
    assert (found.verdict, found.effects) == ("partly_explained", ("friction",))
    assert found.unmodelled == pytest.approx(0.6)
    inside = decide(ignore_unmodelled(weights))
    assert (inside.verdict, inside.selected) == ("missing_effect", 1)
    weights = within(weight("coulomb filter", 0.97), weight("filter", 0.03))
    found = decide(restrict_to(weights, {"lag"}))
    assert (found.verdict, found.effects, found.selected) == ("missing_effect", ("lag",), 1)


LAWS = (("x",), ("p",))
BASELINE = Hypothesis("x", "p")
# two families with forms, one without, and one that names nothing
WITH_FORMS = Families(
    {"a": "a", "a2": "a", "a3": "a", "b": "b", "b2": "b", "c": "c", "w": "w"}, frozenset({"w"})
)


def prior(effects, families=WITH_FORMS, baseline=BASELINE):
    hypothesis = Hypothesis("x", "p", frozenset(effects))
    return math.exp(log_prior(hypothesis, baseline, LAWS, families, DiagnosisSettings()))


def sets(names):
    return [some for size in range(len(names) + 1) for some in combinations(names, size)]


def test_prior_sums_to_one():
    settings, effects = DiagnosisSettings(complete=0.5, chosen_law=0.6), ("a", "b", "c")
    laws, families = (("x", "y", "z"), ("p", "q")), Families({name: name for name in effects})
    total = sum(
        math.exp(log_prior(Hypothesis(e, r, frozenset(some)), BASELINE, laws, families, settings))
        for e, r, some in product(*laws, sets(effects))
    )
    # sets of more effects than there are would hold the rest
    assert total == pytest.approx(1.0 - 0.5**4)
    assert sum(map(prior, sets(WITH_FORMS.family_of))) == pytest.approx(1.0 - 0.5**5)


@pytest.mark.parametrize(
    ("effects", "probability"),
    [
        ((), 1 / 2),
        (("c",), 1 / 4 / 4),  # one of four families
        (("a",), 1 / 4 / 4 / 2),  # the listed law's half,
        (("a2",), 1 / 4 / 4 / 4),  # and two forms share the other
        (("a", "b2"), 1 / 8 / 6 / 2 / 2),  # one of six pairs
        (("a3", "w"), 1 / 8 / 6 / 4),
        (("a", "a2"), 0.0),  # one family twice
    ],
)
def test_a_familys_members_share_its_probability(effects, probability):
    assert prior(effects) == pytest.approx(probability, rel=1e-12, abs=0.0)


def test_what_the_user_put_in_takes_its_family_and_families_follow_from_the_classes():
    baseline = Hypothesis("x", "p", frozenset({"a2"}))
    for effects, probability in (({"a2"}, 1 / 2), ({"a2", "c"}, 1 / 4 / 3), ({"a2", "a"}, 0.0)):
        assert prior(effects, baseline=baseline) == pytest.approx(probability)
    assert prior({"a2"}, Families({"a2": "a", "a3": "a", "c": "c"})) == pytest.approx(1 / 16)
    assert prior({"friction"}, Families.from_kinds(EFFECTS)) == pytest.approx(0.25 / len(EFFECTS))
    families = Families.from_kinds(EVERY)
    forms = ["pressure_friction", "sharp_friction", "guide_friction"]
    assert families.members("friction") == ["friction", *forms]
    assert families.unmodelled == {"slow_change", "offsets_by_test"}
    found = families.forms_in({"pressure_friction", "inertia", "slow_change"})
    assert found == {"friction": "pressure_friction", "inertia": "inertia"}


SUPPORT = Support(1.0, 3.0, 0.1, 0.2, 0.5, effects=1)


def test_features_are_what_they_are_called_and_each_makes_surer_or_less_sure():
    """They count as the ends of what the studies showed beyond these."""
    assert np.allclose(features(50.0, SUPPORT), [math.asinh(50.0), 1.0, 3.0, 0.2, 0.0, 1.0])
    assert len(features(50.0, SUPPORT)) == len(FEATURES)
    surely = features(50.0, structs.replace(SUPPORT, heldout_sds=40.0, p_left=0.001))
    assert (surely[2], surely[4]) == (5.0, 1.0)

    def sure(factor=20.0, **changes):
        return certainty(0.99, factor, structs.replace(SUPPORT, **changes))

    assert sure(100.0) > sure(5.0)
    for name, less, more in (
        ("heldout_gain", 0.1, 1.5), ("heldout_sds", 0.5, 4.0), ("effects", 3, 1),
        ("p_left", 0.0, 0.5), ("error_left", 1.0, 0.1),
    ):  # fmt: skip
        assert sure(**{name: less}) < sure(**{name: more}), name
    assert sure(heldout_gain=40.0) == sure(heldout_gain=calibration().high[1])
    whole, half = (sure(strengths=Strengths(0.1, one, ())) for one in (1.0, 0.5))
    assert half == pytest.approx(0.5 * whole)
    # hardly likely; nothing to compare with; no support
    for known in ((0.5 * LEAST, 20.0, SUPPORT), (0.99, None, SUPPORT), (0.99, 20.0, None)):
        assert certainty(*known) is None


def test_the_weights_are_those_of_the_published_studies_and_calibrated_on_others():
    """In no bin is the share that was there farther from the bin than chance allows (3 sd)."""
    known = calibration()
    learnt = learning.weights_of(list(known.runs))
    assert np.allclose(learnt["weights"], known.weights, rtol=1e-6)
    assert learnt["names"] == known.names
    assert [tuple(one) for one in learnt["bins"]] == list(known.bins)
    for low, high, count, there in known.bins:
        middle = 0.5 * (low + high)
        spread = math.sqrt(middle * (1.0 - middle) / count)
        assert low - 3.0 * spread < there / count < high + 3.0 * spread
