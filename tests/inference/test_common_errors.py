"""An error that tests share is one unknown of all of them."""

from dataclasses import replace

import numpy as np
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.result import Estimate
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.diagnosis.summary.summarizing import contact_error, contact_notices
from qlvbayes.inference.errors.whitening import stage_changes
from qlvbayes.io.data import Pad
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare

SD = 0.02  # mm


def on_one_stage(stage="12.4"):
    known = hidden_pad(rates=(1.0, 20.0))
    tests = tuple(replace(trial.test, contact_sd=SD, contact_stage=stage) for trial in known.trials)
    return prepare(Pad(known.pad, tests, known.units))


def test_a_shared_error_is_whitened_with_the_covariance_that_it_makes():
    experiment = on_one_stage()
    density = build_search(experiment, kinds=FEW).density
    whitener, blocks = density.whitener, density.space.record.blocks
    assert whitener.common is not None
    assert len(stage_changes(experiment.trials, blocks)) == 1
    assert not np.any(blocks.zero)
    covariance = whitener.covariance
    between = covariance[np.ix_(whitener.tests == 0, whitener.tests == 1)]
    assert np.abs(between).max() > 0.0
    white = whitener.matrix @ covariance @ whitener.matrix.T
    assert np.abs(white - np.eye(len(white))).max() < 1e-6
    some = np.random.default_rng(0).standard_normal((2, len(white)))
    np.testing.assert_allclose(whitener.whiten(some), some @ whitener.matrix.T, atol=1e-8)
    last = whitener.tests == 1
    rest = whitener.without(last)
    np.testing.assert_allclose(rest.covariance, covariance[np.ix_(~last, ~last)])


def test_a_force_that_is_off_by_the_error_of_its_zero_costs_at_most_half_a_nat():
    known, sd = hidden_pad(rates=(1.0, 20.0)), 0.02

    def cost(tare_sd):
        """Return minus the log likelihood of one test that is off by sd, over the best."""
        tests = [replace(trial.test, tare_sd=tare_sd) for trial in known.trials]
        pad = Pad(known.pad, tuple(tests), known.units)
        density = build_search(prepare(pad), kinds=FEW).density
        off = np.zeros_like(density.space.record.blocks.force)
        off[0] = sd
        return 0.5 * float((density.whitener(off[None]) ** 2).sum())

    assert 0.3 < cost(sd) < 0.5
    assert cost(0.0) > 10.0


def test_a_named_offset_is_told_to_lie_within_the_error_of_the_contact_or_beyond():
    experiment = on_one_stage()
    assert contact_error(experiment) == SD
    assert abs(contact_error(on_one_stage("")) - SD / np.sqrt(2.0)) < 1e-12
    for gap, told in ((-0.38, "contradicts"), (0.03, "agrees with")):
        for name in ("contact_offset.gap", "gradual_contact.gap"):
            (notice,) = contact_notices(experiment, {name: Estimate("mm", gap, 0.01)})
            assert f"{told} the measured contact" in notice
    assert not contact_notices(experiment, {"backlash.gap": Estimate("mm", -0.38, 0.01)})


def test_white_noise_is_independent_and_as_large_as_all_that_was_measured():
    experiment = hidden_pad(rates=(1.0, 20.0))
    found = build_search(experiment, Choices(noise="white"), kinds=FEW).density.whitener
    for covariance in found.covariances:
        between = covariance - np.diag(np.diag(covariance))  # errors of the motion alone
        assert np.abs(between).max() < 0.05 * np.diag(covariance).min()
    one = np.asarray(build_search(experiment, kinds=FEW).density.space.record.blocks.count)[0, 0]
    expected = experiment.floor.total**2 / one
    assert abs(float(found.covariances[0][0, 0]) - expected) < 0.05 * expected
