"""The diagnosis against pads of which the hidden effect is known."""

from dataclasses import replace

import numpy as np
import pytest
from support.hidden_pads import FEW, hidden_pad

from qlvbayes import Choices, InputError
from qlvbayes.diagnosis.checks.samples import Samples, error, leave_out, predicted
from qlvbayes.diagnosis.checks.sensitivity import responses, unseen
from qlvbayes.diagnosis.diagnose import StopSearch, diagnose
from qlvbayes.diagnosis.searchsetup import build_search, protocol_of
from qlvbayes.effects.catalogue import find
from qlvbayes.simulate import HIDDEN, TABLE_1, full_retraction_protocol, paper_protocol

RATES = (0.1, 1.0, 20.0, 100.0)
OF_UNLOADING = tuple(map(find, ("adhesion", "stress_softening")))


def measured(effects=(), pad="B", seed=0, protocol=paper_protocol, rates=RATES):
    """Simulate a pad's tests with hidden effects and make them ready."""
    constants = TABLE_1[pad]
    return hidden_pad(*effects, rates=rates, constants=constants, seed=seed, protocol=protocol)


@pytest.fixture(scope="module")
def plain():
    return diagnose(measured())


@pytest.fixture(scope="module")
def drag():
    return diagnose(measured([HIDDEN["viscous_drag"](eta=0.004)]))


@pytest.mark.slow
def test_nothing_missing_is_called_adequate_and_what_hides_says_what_it_would_bend(plain):
    assert plain.result.verdict == "adequate"
    assert plain.result.effects == ()
    assert plain.result.ranking[0].effect == "none"
    assert plain.result.stages[-1].heldout_rmse < 1.2 * plain.result.noise
    biases = {bias.effect: bias for bias in plain.result.biases}
    assert "frame_compliance" in biases
    assert biases["frame_compliance"].left < 0.15
    assert biases["frame_compliance"].changes["b"] < 0.0  # a soft frame looks like less stiffening


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
def test_a_watched_search_sees_all_neighbours_or_is_ended_and_what_is_known_is_told():
    """The standing is the decision on the way; ended when the drag is likely, it is named."""
    standings, whole = [], []

    def watch(standing):
        standings.append(standing)
        if standing.decision.inclusion.get("viscous_drag", 0.0) > 0.9:
            raise StopSearch

    pad = measured([HIDDEN["viscous_drag"](eta=0.004)])
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
    effects = [HIDDEN["viscous_drag"](eta=0.004), HIDDEN["force_offset"](offset=0.08)]
    two = diagnose(measured(effects)).result
    assert set(two.effects) == {"viscous_drag", "force_offset"}
    errors = [stage.heldout_rmse for stage in two.stages]
    assert len(errors) == 3
    assert errors[-1] < min(1.2 * two.noise, errors[0] / 3.0)


@pytest.mark.slow
def test_adhesion_shows_only_where_the_platen_retracts():
    """A ramp and hold that never unloads cannot show softening, set or adhesion."""
    reasons = []
    for protocol in (lambda rate: paper_protocol(rate)[:2], full_retraction_protocol):
        experiment = measured(protocol=protocol, rates=(1.0, 100.0))
        search = build_search(experiment, kinds=OF_UNLOADING)
        search.evaluate(search.baseline)
        found = responses(search, search.modes[search.baseline][0])
        hidden = unseen(found, search, protocol_of(experiment, bonded=False))
        reasons.append({one.effect: one.reason for one in hidden})
    assert reasons[0]["adhesion"] == "no test retracts to zero depth"
    assert reasons[0]["stress_softening"] == "no test unloads"
    assert "adhesion" not in reasons[1]


def test_holds_at_one_depth_cannot_show_a_strength_that_changes_with_depth():
    """A press and a hold at full depth; the paper's tests also hold half of it on the way back."""
    for steps, at_one in ((2, True), (None, False)):
        protocol = lambda rate, steps=steps: paper_protocol(rate)[:steps]  # noqa: E731
        experiment = measured(protocol=protocol, rates=(1.0, 100.0))
        assert protocol_of(experiment, bonded=False).one_depth is at_one


@pytest.fixture(scope="module")
def alone():
    """One test of a pad with nothing hidden."""
    return diagnose(measured(rates=(20.0,)), kinds=FEW)


def test_priors_that_leave_no_finite_force_are_refused():
    with pytest.raises(InputError, match="narrow the priors"):
        diagnose(measured(rates=(20.0,)), Choices(priors=("b=lognormal(9,0.1)",)))


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
    moved = build_search(shifted, kinds=(type(search.density.space.effects["viscous_drag"]),))
    samples = Samples.from_experiment(shifted, moved.density.space)
    found = error(predicted(samples, leave_out(moved.density, samples)[:1], selected.mode))
    assert found == pytest.approx(np.hypot(expected, 0.5), rel=0.05)


def test_where_nothing_is_hidden_nothing_is_missing_and_of_one_test_phases_are_left_out(alone):
    """The error reported for parts left out is never the error of the fit."""
    result, work = alone.result, alone.work
    assert (result.verdict, result.effects, result.group) == ("adequate", (), ())
    assert work.search.best == work.search.baseline
    parts = leave_out(work.search.density, work.samples)
    assert len(parts) == len(work.experiment.trials[0].phases)
    expected = error(predicted(work.samples, parts, work.selected.mode))
    assert expected > result.stages[-1].rmse
    assert result.stages[-1].heldout_rmse == pytest.approx(expected, rel=1e-12)
