"""Check the uncertainty of moments: readings next to kinks of the motion, and uncertain clocks."""

from dataclasses import replace

import numpy as np
import pytest
from support.hidden_pads import hidden_pad

from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import EFFECTS, FORMS
from qlvbayes.inference.starts import amplitude_of, shapes
from qlvbayes.motion.reduction import kink_sds, timing_sd
from qlvbayes.motion.trajectory import Trajectory

KINK, SPEED = 2.0, 5.0  # s, mm/s


def ramp_and_hold(**more):
    """A ramp that ends at once at the kink."""
    return Trajectory(
        np.array([0.0, KINK, 10.0]),
        np.array([0.0, SPEED * KINK]),
        np.array([SPEED, 0.0]),
        np.zeros(2),
        0.0,
        **more,
    )


def drag(time, at, size):
    """A force that jumps down by ``size`` at a moment."""
    return np.where(time < at, size, 0.0)


def singles(time):
    return np.arange(time.size)


@pytest.mark.parametrize("apart", [-0.02, -0.005, 0.0, 0.003, 0.01, 0.05])
def test_a_jump_at_an_uncertain_moment_has_the_variance_that_draws_have(apart):
    """The kink lies anywhere within a sampling interval: p (1 - p) of the jump squared."""
    time = np.arange(0.0, 4.0, 0.01) + apart % 0.01
    reading = int(np.argmin(np.abs(time - KINK - apart)))
    (sd,) = kink_sds(time, ramp_and_hold())
    assert sd == pytest.approx(0.01 / np.sqrt(12.0))
    moments = KINK + sd * np.random.default_rng(0).standard_normal(20_000)
    expected = np.std([drag(time[reading], at, 0.3) for at in moments])
    # as the record shows the jump if it is between this reading and the next one
    force = drag(time, time[reading] + 1e-9, 0.3)
    found = timing_sd(time, force, singles(time), ramp_and_hold(), 0.0)[reading]
    assert found == pytest.approx(expected, abs=0.3 * 0.02)


def test_far_from_kinks_nothing_is_added_and_noise_or_a_steep_force_are_no_jump():
    """The line through its neighbours goes through a reading of a ramp that goes on."""
    time = np.arange(0.0, 4.0, 0.01)
    noise = 0.01 * np.random.default_rng(1).standard_normal(time.size)
    found = timing_sd(time, noise, singles(time), ramp_and_hold(), 0.01)
    assert np.max(found[np.abs(time - KINK) >= 0.02]) < 1e-6
    assert np.max(found) < 0.02
    assert timing_sd(time, 3.0 * time, singles(time), ramp_and_hold(), 0.0)[1:-1].max() < 1e-9


def test_an_uncertain_clock_counts_by_the_slope_of_the_force():
    """Against readings whose moments are drawn."""
    time, clock = np.arange(0.0, 10.0, 0.02), 2e-3
    slope = 0.7
    motion = ramp_and_hold(clock_sd=clock)
    begin = np.arange(0, time.size, 4)
    found = timing_sd(time, slope * time, begin, motion, 0.0)
    away = np.abs(time[begin] - KINK) > 0.2
    drawn = clock * np.random.default_rng(2).standard_normal((5000, 4))
    expected = (slope * drawn).mean(axis=1).std()
    np.testing.assert_allclose(found[away][1:-1], expected, rtol=0.05)


@pytest.fixture(scope="module")
def search():
    """A pad whose readings lie at kinks of the motion, with drag, as the motion is known there."""
    experiment = hidden_pad(rates=(1.0, 20.0))
    trials = []
    for trial in experiment.trials:
        test, kinks = trial.test, trial.trajectory.kinks
        time = np.unique(np.concatenate([test.time, kinks]))
        force = np.interp(time, test.time, test.force)
        path = trial.trajectory.displacement(time)
        trials.append(replace(trial, test=replace(test, time=time, displacement=path, force=force)))
    found = build_search(replace(experiment, trials=tuple(trials)))
    found.evaluate(found.baseline)
    return found


@pytest.mark.parametrize("below", [(), ("viscous_drag", "inertia")], ids=["plain", "drag"])
def test_a_billionth_of_an_effect_moves_no_block_mean(search, below):
    """At kinks too, where a drag and a mass make the force jump."""
    space, peak = search.density.space, search.density.discrepancy.peak
    base = replace(search.baseline, effects=frozenset(below))
    own = space.parameters(base)
    theta = np.zeros(own.size)
    point = search.modes[search.baseline][0].point
    theta[own.positions_of(point.own)] = point.theta
    for name in below:
        amplitude = amplitude_of(own, name)
        theta[amplitude.number] = 3.0 * amplitude.sd
    start = search.density.at(base, theta)
    for kind in (*EFFECTS, *FORMS):
        if kind.name in below or kind.name not in space.effects:
            continue
        more = base.plus(kind.name)
        other = space.parameters(more)
        one = shapes(space, start, other, kind.name)[0]
        amplitude = amplitude_of(other, kind.name)
        nothing, slight = one.copy(), one.copy()
        slight[amplitude.number] += 1e-9 * amplitude.sd
        forces = space.forces(more, other.constants(np.stack([nothing, slight])))
        assert np.max(np.abs(forces[1] - forces[0])) < 1e-6 * peak, kind.name
