"""Parts of an ensemble: whichever is run, the force and its slopes are the same."""

from dataclasses import replace

import numpy as np
import pytest
from support.endtoend import experiment

from qlvbayes.effects.channel_lag import ChannelLag
from qlvbayes.effects.frame_compliance import FrameCompliance
from qlvbayes.effects.viscous_drag import ViscousDrag
from qlvbayes.fitting.fit import build_posterior
from qlvbayes.inference.gaussnewton import CHUNK, evaluate, predict_along
from qlvbayes.inference.linearised import predictions_along
from qlvbayes.inference.subset import with_every_effect
from qlvbayes.model.choices import Choices

KINDS = (ViscousDrag, FrameCompliance, ChannelLag)
COSTLY = ("frame_compliance", "channel_lag")


@pytest.fixture(scope="module")
def ensemble():
    posterior = build_posterior(experiment(), Choices(noise="correlated"), experiment().trials)
    effects = tuple(kind.default(experiment().scales) for kind in KINDS)
    return with_every_effect(posterior, effects, COSTLY)


def test_each_direction_runs_on_the_cheapest_part(ensemble):
    constants = ensemble.subset().nulled(
        evaluate(ensemble, ensemble.subset(), ensemble.centre).constants
    )
    lag = np.zeros(constants.size)
    lag[ensemble.amplitude("channel_lag")] = 1.0
    assert ensemble.part(constants).effects == frozenset()
    assert ensemble.part(constants, lag).effects == {"channel_lag"}
    constants[ensemble.amplitude("viscous_drag")] = 0.01
    assert ensemble.part(constants, lag).effects == {"channel_lag", "viscous_drag"}


def test_parts_agree_with_the_whole(ensemble):
    point = evaluate(ensemble, ensemble.subset(), ensemble.centre)
    everything = ensemble.subset(tuple(ensemble.candidates))
    constants = np.array(evaluate(ensemble, everything, ensemble.centre).constants)
    constants[[ensemble.amplitude(name) for name in ensemble.candidates]] = 0.0
    amplitudes = [ensemble.amplitude(name) for name in ensemble.candidates]
    directions = np.concatenate([point.slopes.T, np.eye(constants.size)[amplitudes]])
    force, slopes = predict_along(ensemble, constants, directions)
    whole = ensemble.parts[-1]
    for first in range(0, len(directions), CHUNK):
        some = np.zeros((CHUNK, constants.size))
        rows = directions[first : first + CHUNK]
        some[: len(rows)] = rows
        expected, along = predictions_along(whole.posterior, constants, some)
        np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-12)
        scale = np.abs(np.asarray(along)).max()
        np.testing.assert_allclose(
            slopes[first : first + CHUNK], np.asarray(along)[: len(rows)], atol=1e-9 * scale
        )


def test_beside_other_tests_every_part_has_them(ensemble):
    assert ensemble.parts  # found before the tests are changed
    blocks = ensemble.posterior.record.blocks
    record = replace(ensemble.posterior.record, blocks=replace(blocks, force=2.0 * blocks.force))
    other = ensemble.with_record(record)
    for beside in (other, *other.parts):
        np.testing.assert_array_equal(beside.posterior.record.blocks.force, record.blocks.force)
