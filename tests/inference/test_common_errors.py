"""An error that tests share is one unknown of all of them."""

from dataclasses import replace

import numpy as np
from support.hidden_pads import FEW, hidden_pad

from qlvbayes.diagnosis.checks.naming import contact_error, contact_notices
from qlvbayes.diagnosis.result import Estimate
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.inference.errors.whitening import stage_changes
from qlvbayes.io.data import Pad
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


def test_a_named_offset_beyond_the_error_of_the_contact_is_told():
    experiment = on_one_stage()
    assert contact_error(experiment) == SD
    assert abs(contact_error(on_one_stage("")) - SD / np.sqrt(2.0)) < 1e-12
    for gap, told in ((-0.38, True), (0.03, False)):
        for name in ("contact_offset.gap", "gradual_contact.gap"):
            notices = contact_notices(experiment, {name: Estimate("mm", gap, 0.01)})
            assert len(notices) == told
            assert not told or "contradicts the measured contact" in notices[0]
    assert not contact_notices(experiment, {"backlash.gap": Estimate("mm", -0.38, 0.01)})
