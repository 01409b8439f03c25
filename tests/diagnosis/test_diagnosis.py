"""The diagnosis against pads of which the hidden effect is known."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed
from support.hidden_pads import FEW, hidden_pad, with_changes

from qlvbayes import Choices, InputError
from qlvbayes.diagnosis.checks.adequacy import adequacy
from qlvbayes.diagnosis.checks.heldout import error, leave_out, predicted
from qlvbayes.diagnosis.checks.samples import Samples
from qlvbayes.diagnosis.checks.sensitivity import responses, unseen
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.progress import StopSearch
from qlvbayes.diagnosis.result import ParameterBias
from qlvbayes.diagnosis.searchsetup import build_search, protocol_of
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.effects.catalogue import find
from qlvbayes.fitting.prediction import single_samples
from qlvbayes.inference.modes import find_mode
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


@pytest.fixture(scope="module")
def two():
    effects = [HIDDEN["viscous_drag"](eta=0.004), HIDDEN["force_offset"](offset=0.08)]
    return diagnose(measured(effects))


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
def test_a_hidden_drag_is_named_with_its_size_and_its_evidence_is_sampled(drag):
    assert drag.result.verdict == "missing_effect"
    assert drag.result.effects == ("viscous_drag",)
    eta = drag.result.stages[-1].parameters["viscous_drag.eta"]
    assert abs(eta.mean - 0.004) < 4.0 * eta.sd
    assert drag.result.ranking[0].inclusion > 0.9
    before, after = (drag.result.stages[k].heldout_rmse for k in (0, -1))
    assert after < 1.2 * drag.result.noise < before
    first, *_ = drag.result.alternatives
    assert 0.0 < first.log_evidence_error < 0.3
    named = drag.result.ranking[0]
    assert 0.0 <= named.inclusion_error < 0.05
    first, *others = drag.result.stages
    nearer = changed(first, heldout_rmse=0.5 * others[-1].heldout_rmse)
    assert "falls from" in drag.text()
    assert "falls from" not in with_changes(drag, stages=(nearer, *others)).text()


@pytest.mark.slow
def test_a_watched_search_can_be_ended_and_what_is_known_is_told():
    """The standing is the decision on the way; ended when the drag is likely, it is named."""
    standings = []

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
    whole = []
    diagnose(pad, kinds=FEW, watch=whole.append)
    assert len(whole) > len(standings)


@pytest.mark.slow
def test_two_effects_are_found_one_by_one(two):
    assert set(two.result.effects) == {"viscous_drag", "force_offset"}
    errors = [stage.heldout_rmse for stage in two.result.stages]
    assert len(errors) == 3
    assert errors[-1] < min(1.2 * two.result.noise, errors[0] / 3.0)


@pytest.mark.slow
def test_adhesion_shows_only_where_the_platen_retracts():
    """A ramp and hold that never unloads cannot show softening, set or adhesion."""
    experiment = measured(protocol=lambda rate: paper_protocol(rate)[:2], rates=(1.0, 100.0))
    reasons = _not_seen(experiment)
    assert reasons["adhesion"] == "no test retracts to zero depth"
    assert reasons["stress_softening"] == "no test unloads"
    full = measured(protocol=full_retraction_protocol, rates=(1.0, 100.0))
    assert "adhesion" not in _not_seen(full)


def test_holds_at_one_depth_cannot_show_a_strength_that_changes_with_depth():
    """A press and a hold at full depth; the paper's tests also hold half of it on the way back."""
    for steps, at_one in ((2, True), (None, False)):
        protocol = lambda rate, steps=steps: paper_protocol(rate)[:steps]  # noqa: E731
        experiment = measured(protocol=protocol, rates=(1.0, 100.0))
        assert protocol_of(experiment, bonded=False).one_depth is at_one


def _not_seen(experiment):
    """Effects that the tests cannot show, and why; no search is run for it."""
    search = build_search(experiment, kinds=OF_UNLOADING)
    search.evaluate(search.baseline)
    found = responses(search, search.modes[search.baseline][0])
    return {
        u.effect: u.reason for u in unseen(found, search, protocol_of(experiment, bonded=False))
    }


@pytest.mark.parametrize(
    ("change", "words"), [(0.04, "4 % too high"), (-1.58, "more than half too low")]
)
@pytest.mark.slow
def test_no_constant_is_said_to_fall_by_more_than_all_of_itself(plain, change, words):
    bias = ParameterBias("inertia", "inertia.mass", 1.0, 0.1, {"b": change}, visible=False)
    said = "\n".join(with_changes(plain, biases=(bias,)).paragraphs())
    assert f"b would be {words}" in said


def test_priors_that_leave_no_finite_force_are_refused():
    with pytest.raises(InputError, match="narrow the priors"):
        diagnose(measured(rates=(20.0,)), Choices(priors=("b=lognormal(9,0.1)",)))


@pytest.mark.slow
def test_adequacy_p_values_are_uniform_under_a_right_model(plain):
    """Whatever the noise that comes with the same pad, one in ten is below a tenth."""
    work = plain.work
    below = 0
    for seed in range(20):
        experiment = measured(seed=100 + seed)
        found = _plain_point(experiment, work)
        below += adequacy(experiment, found[0], found[1], DiagnosisSettings().cells).p_value < 0.1
    assert below <= 6  # binomial: more than 6 of 20 has probability 0.002


@pytest.mark.slow
def test_the_support_of_an_effect_that_is_there():
    """Tests left out and strengths all speak for it; of improbable ones nothing is known."""
    pad = measured([HIDDEN["viscous_drag"](eta=0.004)], rates=(1.0, 20.0, 100.0))
    drag = diagnose(pad, kinds=FEW)
    first, *others = (one for one in drag.result.ranking if one.effect != "none")
    assert first.effect == "viscous_drag"
    support, stages = first.support, drag.result.stages
    before, after = (stages[k].heldout_rmse for k in (0, -1))
    assert support.heldout_gain > np.log(before / after)  # the error falls most where it acts
    assert support.heldout_sds > 1.0
    assert support.strengths.agreement > 0.9
    assert support.error_left == pytest.approx(np.log(stages[-1].rmse / drag.result.noise), abs=0.1)
    assert support.p_left > 0.01
    assert all(one.support is None for one in others if one.inclusion < 0.1)


def _plain_point(experiment, work):
    """Record and mode of the plain model of the same pad under other noise."""
    search = build_search(experiment, kinds=())
    start = work.path[0].point.theta
    return search.density.space.record, find_mode(search.density, search.baseline, start).point


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


@pytest.mark.slow
def test_samples_are_predicted_as_by_the_model_itself(drag):
    """Parts of a record, each by the compiled functions of the fit, against one run of all.

    Their grids differ; each is within a quarter of an encoder step of the motion.
    """
    work = drag.work
    selected, samples = work.selected, work.samples
    model = selected.point.own.model_at(selected.point.constants)
    predicted = samples.predict(selected.hypothesis, selected.point.constants[None])
    for k, (trial, rows) in enumerate(zip(samples.trials, samples.rows, strict=True)):
        record = single_samples(work.experiment, trial, rows)
        expected = np.asarray(record.average(model.force(record.motion)))
        stiffness = float(model.elastic.stiffness(np.max(trial.test.displacement)))
        bound = 0.25 * trial.trajectory.resolution * stiffness
        assert bound < 0.1 * work.experiment.floor.total
        np.testing.assert_allclose(predicted[k][0], expected, atol=bound)


def test_of_one_test_alone_phases_are_left_out():
    """The error reported for parts left out is never the error of the fit."""
    found = diagnose(measured(rates=(20.0,)), kinds=FEW)
    work = found.work
    parts = leave_out(work.search.density, work.samples)
    assert len(parts) == len(work.experiment.trials[0].phases)
    expected = error(predicted(work.samples, parts, work.selected.mode))
    assert expected > found.result.stages[-1].rmse
    assert found.result.stages[-1].heldout_rmse == pytest.approx(expected, rel=1e-12)
