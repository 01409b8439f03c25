"""The diagnosis against pads of which the hidden effect is known, or is on no list."""

from dataclasses import replace

import numpy as np
import pytest
from blind.catalogue import OUTSIDE
from msgspec import structs
from support.hidden_pads import FEW, hidden_pad, keeps_diagnosis_contract

from qlvbayes import Choices, InputError, StopSearch
from qlvbayes.diagnosis.checks.outcome import averaged
from qlvbayes.diagnosis.checks.samples import Samples, error, leave_out, predicted
from qlvbayes.diagnosis.checks.sensitivity import responses, unseen
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import Estimate
from qlvbayes.diagnosis.searchsetup import build_search, protocol_of
from qlvbayes.diagnosis.settings import Breadth, DescriptionSettings, DiagnosisSettings
from qlvbayes.diagnosis.summary.words import _unnamed
from qlvbayes.effects.catalogue import EFFECTS, find
from qlvbayes.simulate import HIDDEN, PAPER_RATES, full_retraction_protocol, paper_protocol
from qlvbayes.use.prescribed.forecast import predict_program
from qlvbayes.use.prescribed.hypotheses import drawn_hypotheses

RATES = (0.1, 1.0, 20.0, 100.0)
OF_UNLOADING = tuple(map(find, ("adhesion", "stress_softening")))
DRAGS = tuple(map(find, ("viscous_drag", "power_law_drag", "squeeze_film")))
RIVALS = tuple(dict.fromkeys((*FEW, *DRAGS)))
DRAG = HIDDEN["viscous_drag"](eta=0.004)
NARROW = Breadth(starts=2, draws=2, shapes=1, optimised=1, redrawn=0, substitutes=0, sampled=4)


QUICK = DiagnosisSettings(
    breadth=NARROW, description=DescriptionSettings(shapes=2, fitted=2, judged=1)
)


@pytest.fixture(scope="module")
def drag():
    return diagnose(hidden_pad(DRAG, rates=RATES))


@pytest.mark.slow
def test_nothing_missing_is_called_adequate_and_what_hides_says_what_it_would_bend():
    plain = diagnose(hidden_pad(rates=RATES)).result
    assert (plain.verdict, plain.effects, plain.ranking[0].effect) == ("adequate", (), "none")
    assert plain.stages[-1].heldout_rmse < 1.2 * plain.noise
    (soft,) = (bias for bias in plain.biases if bias.effect == "frame_compliance")
    assert soft.left < 0.15
    assert soft.changes["b"] < 0.0  # a soft frame looks like less stiffening


@pytest.mark.slow
def test_a_hidden_drag_is_named_with_its_size_evidence_and_support(drag):
    """Tests left out and strengths all speak for it; of improbable ones nothing is known."""
    result = drag.result
    assert (result.verdict, result.effects) == ("missing_effect", ("viscous_drag",))
    eta = result.stages[-1].parameters["viscous_drag.eta"]
    assert abs(eta.mean - 0.004) < 4.0 * eta.sd
    first, *others = (one for one in result.ranking if one.effect != "none")
    assert (first.effect, first.inclusion > 0.9) == ("viscous_drag", True)
    assert 0.0 <= first.inclusion_error < 0.05
    assert 0.0 < result.alternatives[0].log_evidence_error < 0.3
    before, after = (result.stages[k].heldout_rmse for k in (0, -1))
    assert after < 1.2 * result.noise < before
    support = first.support
    assert support.heldout_gain > np.log(before / after)  # the error falls most where it acts
    assert support.heldout_sds > 1.0
    assert support.strengths.agreement > 0.9
    assert support.error_left == pytest.approx(
        np.log(result.stages[-1].rmse / result.noise), abs=0.1
    )
    assert support.p_left > 0.01
    assert all(one.support is None for one in others if one.inclusion < 0.1)


@pytest.mark.slow
def test_left_out_is_predicted_from_the_others_only(drag):
    """A test's own readings have no part in its prediction."""
    work = drag.work
    search, selected = work.search, work.selected
    parts = leave_out(search.density, work.samples)
    expected = error(predicted(work.samples, parts[:1], selected.mode))
    trials = work.experiment.trials
    other = replace(trials[0], test=replace(trials[0].test, force=trials[0].test.force + 0.5))
    shifted = replace(work.experiment, trials=(other, *trials[1:]))
    moved = build_search(shifted, kinds=(find("viscous_drag"),))
    samples = Samples.from_experiment(shifted, moved.density.space)
    found = error(predicted(samples, leave_out(moved.density, samples)[:1], selected.mode))
    assert found == pytest.approx(np.hypot(expected, 0.5), rel=0.05)


@pytest.mark.slow
def test_a_watched_search_sees_all_neighbours_or_is_ended_and_what_is_known_is_told():
    """The standing is the decision on the way; ended when the drag is likely, it is named."""
    standings, whole = [], []

    def watch(standing):
        standings.append(standing)
        if standing.decision.inclusion.get("viscous_drag", 0.0) > 0.9:
            raise StopSearch

    pad = hidden_pad(DRAG, rates=RATES)
    found = diagnose(pad, kinds=FEW, watch=watch)
    seen = [one.seen for one in standings]
    assert seen == sorted(seen)
    assert "viscous_drag" not in standings[0].decision.inclusion
    assert "viscous_drag" in standings[-1].best.effects
    assert found.result.effects == ("viscous_drag",)
    search = diagnose(pad, kinds=FEW, watch=whole.append).work.search
    assert len(whole) > len(standings)
    best = search.best
    for name in set(search.families.nameable) - best.effects:
        assert best.plus(name) in search.candidates
    assert best.less("viscous_drag") in search.candidates


@pytest.mark.slow
def test_two_effects_are_found_one_by_one():
    two = diagnose(hidden_pad(DRAG, HIDDEN["force_offset"](offset=0.08), rates=RATES)).result
    assert set(two.effects) == {"viscous_drag", "force_offset"}
    errors = [stage.heldout_rmse for stage in two.stages]
    assert len(errors) == 3
    assert errors[-1] < min(1.2 * two.noise, errors[0] / 3.0)


@pytest.mark.slow
def test_adhesion_shows_only_where_the_platen_retracts():
    """A ramp and hold that never unloads cannot show softening, set or adhesion."""
    reasons = []
    for protocol in (lambda rate: paper_protocol(rate)[:2], full_retraction_protocol):
        experiment = hidden_pad(protocol=protocol, rates=(1.0, 100.0))
        search = build_search(experiment, kinds=OF_UNLOADING)
        search.evaluate(search.baseline)
        found = responses(search, search.modes[search.baseline][0])
        hidden = unseen(found, search, protocol_of(experiment, bonded=False))
        reasons.append({one.effect: one.reason for one in hidden})
    assert reasons[0]["adhesion"] == "no test retracts to zero depth"
    assert reasons[0]["stress_softening"] == "no test unloads"
    assert "adhesion" not in reasons[1]


@pytest.mark.parametrize(("steps", "at_one"), [(2, True), (None, False)])
def test_holds_at_one_depth_cannot_show_a_strength_that_changes_with_depth(steps, at_one):
    """A press and a hold at full depth; the paper's tests also hold half of it on the way back."""
    experiment = hidden_pad(protocol=lambda rate: paper_protocol(rate)[:steps], rates=(1.0, 100.0))
    assert protocol_of(experiment, bonded=False).one_depth is at_one


def test_where_nothing_is_hidden_nothing_is_missing_and_of_one_test_phases_are_left_out():
    """The error reported for parts left out is never the error of the fit."""
    one = hidden_pad(rates=(20.0,))
    alone = diagnose(one, kinds=FEW)
    result, work = alone.result, alone.work
    assert (result.verdict, result.effects, result.group) == ("adequate", (), ())
    assert work.search.best == work.search.baseline
    parts = leave_out(work.search.density, work.samples)
    assert len(parts) == len(work.experiment.trials[0].phases)
    expected = error(predicted(work.samples, parts, work.selected.mode))
    assert expected > result.stages[-1].rmse
    assert result.stages[-1].heldout_rmse == pytest.approx(expected, rel=1e-12)
    with pytest.raises(InputError, match="narrow the priors"):
        diagnose(one, Choices(priors=("b=lognormal(9,0.1)",)))


@pytest.mark.slow
def test_a_steady_drift_is_one_and_a_jump_in_the_middle_of_a_study_none_alone():
    """A drift may take a part of what gives way, but something else is there and said to be."""
    given_way = OUTSIDE["slow_creep_jump"](offset=-0.1, begin=280.0, time=15.0)
    jump = diagnose(hidden_pad(given_way, rates=PAPER_RATES), kinds=FEW).result
    assert jump.verdict in ("partly_explained", "unexplained")
    assert jump.outside > 0.5
    assert jump.stages[-1].rmse > 1.5 * jump.noise
    steady = hidden_pad(HIDDEN["force_drift"](rate=1e-4), rates=PAPER_RATES)
    found = diagnose(steady, kinds=FEW).result
    assert (found.verdict, found.effects) == ("missing_effect", ("force_drift",))
    drift = found.stages[-1].parameters["force_drift.rate"]
    assert abs(drift.mean - 1e-4) < 4.0 * drift.sd
    assert found.outside < 0.5


@pytest.mark.parametrize(
    ("rates", "kinds", "settings"),
    [
        pytest.param((1.0, 100.0), FEW[:2], QUICK, id="few"),
        pytest.param(RATES, EFFECTS, DiagnosisSettings(), id="all", marks=pytest.mark.slow),
    ],
)
def test_what_is_not_on_the_list_is_left_and_told(rates, kinds, settings):
    """An amplifier that cannot read large forces: it clips at 80 % of the largest force."""
    clipped = diagnose(
        hidden_pad(OUTSIDE["amplifier_clipping"](level=1.1), rates=rates),
        kinds=kinds,
        settings=settings,
    )
    result = clipped.result
    keeps_diagnosis_contract(clipped)
    assert result.verdict in ("unexplained", "partly_explained")
    assert result.outside > 0.5
    assert result.stages[-1].p_value < settings.false_alarms
    assert not result.remainder.small
    assert result.remainder.test in " ".join(clipped.paragraphs())
    # predictions are averaged over the alternatives, whatever these hold
    first, *others = result.alternatives
    rest = [structs.replace(one, effects=()) for one in others]
    for share, told in ((0.6, 1), (0.001, 0)):
        held = structs.replace(first, effects=(*first.effects, "wander"), probability=share)
        holding = structs.replace(result, alternatives=(held, *rest))
        assert len(_unnamed(holding, "wander", "what it shows")) == told


def test_the_average_has_the_moments_of_the_mixture():
    rng = np.random.default_rng(0)
    found = [{"m": Estimate("N/mm", 1.0, 0.1)}, {"m": Estimate("N/mm", 2.0, 0.3)}]
    which = rng.choice(2, 400_000, p=np.array([1.0, np.exp(-1.0)]) / (1.0 + np.exp(-1.0)))
    draws = rng.normal(np.array([1.0, 2.0])[which], np.array([0.1, 0.3])[which])
    mixed = averaged([-1000.0, -1001.0], found)["m"]
    assert mixed.unit == "N/mm"
    assert mixed.mean == pytest.approx(draws.mean(), abs=0.005)
    assert mixed.sd == pytest.approx(draws.std(), abs=0.005)


@pytest.fixture(scope="module")
def either():
    """A drag nearly as the speed, in tests that hardly tell it from one just so."""
    drag = HIDDEN["power_law_drag"](k=0.003, n=0.87)
    return diagnose(hidden_pad(drag, rates=RATES), kinds=RIVALS)


@pytest.mark.slow
def test_rivals_make_the_verdict_ambiguous_and_a_further_test_is_suggested(either):
    result, settings = either.result, DiagnosisSettings()
    assert result.verdict == "ambiguous"
    assert {"viscous_drag", "power_law_drag"} <= set(result.group)
    assert result.suggestions[0].evidence > 0.0
    held = [r.inclusion for r in result.ranking if r.effect in result.group]
    assert sum(held) >= settings.covered
    assert max(held) < settings.named
    listed = [one.probability for one in result.not_ruled_out]
    assert listed == sorted(listed, reverse=True)
    assert sum(listed) <= 1.0 + 1e-9
    last = result.stages[-1].parameters
    assert set(result.constants) == {name for name in last if "." not in name}
    weight = result.alternatives[0].probability
    for name, found in result.constants.items():
        # of one hypothesis alone, the share of its weight is the least that its variance keeps
        assert found.sd >= last[name].sd * np.sqrt(weight) * 0.99


@pytest.mark.slow
def test_draws_of_hypotheses_have_their_probabilities_moments_and_bounds(either):
    """Averaged, they predict the motion tested: late in the hold of the fastest test."""
    listed, last = either.result.alternatives, either.result.stages[-1]
    left = drawn_hypotheses(either, Choices())
    assert [(h.base, h.effects) for h in left.hypotheses] == [(h.base, h.effects) for h in listed]
    total = sum(one.probability for one in listed)
    for one in left.hypotheses:
        assert abs(len(one.constants["m"]) - 400 * one.probability / total) <= 1.0
        assert np.allclose(np.sum([one.constants[f"c[{k}]"] for k in range(3)], axis=0), 1.0)
        assert not any(name.startswith("noise.") for name in one.constants)
        assert min(one.constants.get("viscous_drag.eta", (0.0,))) >= 0.0
    drawn = drawn_hypotheses(either, Choices(), draws=8000)
    one = next(h for h in drawn.hypotheses if (h.base, h.effects) == (last.base, last.effects))
    for name in ("m", "b", "v[1]"):
        values, reported = np.array(one.constants[name]), last.parameters[name]
        # four sds of what so many draws say; the reported sd is that of a slope
        most = 4.0 * reported.sd / np.sqrt(values.size) + 0.1 * reported.sd
        assert abs(values.mean() - reported.mean) < most
        assert values.std() == pytest.approx(reported.sd, rel=0.1)
        # what a discrepancy may have moved them by makes them wider than those of the curve
        assert np.std(one.curve[name]) < 1.2 * values.std()
    trial = either.work.experiment.trials[-1]
    found = predict_program(left, "ramp 1.6 mm at 33 mm/s, hold 29 s")
    late = (trial.test.time > 20.0) & (trial.test.time < 29.0)
    low, high = (end[np.searchsorted(found.time, 25.0)] for end in found.band(0.9))
    noise = either.work.experiment.floor.total
    assert late.sum() > 3
    assert low - 2.0 * noise < trial.test.force[late].mean() < high + 2.0 * noise
