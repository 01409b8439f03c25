"""Stated errors of kinks and clocks, in time, against motions whose kinks are known."""

from dataclasses import replace

import numpy as np
import pytest
from support.hidden_pads import hidden_pad
from support.motions import constant_jerk, sampled, trapezoids, triangle

from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import EFFECTS, FORMS
from qlvbayes.inference.starts import shapes
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.reduction import kink_sds, timing_sd
from qlvbayes.motion.sensor import clock_error, last_decimal
from qlvbayes.motion.trajectory import Stroke, Trajectory, planned, smooth

RECORDS = 25


def sharp(speed, lasts, lead):
    """A ramp without acceleration limits between two rests."""
    return constant_jerk([(lead, 0, 0, 0), (lasts, 0, 0, speed), (2.0, 0, 0, 0)], 2)


# motion that begins at a time, sampling interval (s), encoder step (mm), scatter (mm)
KINDS = {
    "sharp, 0.1 mm/s, steps": (lambda at: sharp(0.1, 3.0, at), 1e-3, 1e-3, 0.0),
    "sharp, scatter and steps": (lambda at: sharp(10.0, 0.2, at), 1e-3, 1e-3, 3e-3),
    "sharp, scatter": (lambda at: sharp(10.0, 0.2, at), 1e-3, 0.0, 3e-3),
    "limited acceleration, steps": (lambda at: trapezoids(20.0, lead=at), 1e-3, 1e-3, 0.0),
    "limited acceleration, scatter": (lambda at: trapezoids(20.0, lead=at), 1e-3, 0.0, 3e-3),
    "turns that last 0.1 s": (lambda at: triangle(2.0 + at, 2, 0.1), 1e-2, 1e-3, 0.0),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.few(2)
def test_errors_of_kinks_are_as_large_as_stated(kind):
    """Rounding errors that repeat themselves may be stated up to three times too large."""
    make, interval, step, scatter = KINDS[kind]
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(RECORDS):
        motion = make(0.5 + rng.uniform(0.0, interval))
        t = sampled(motion, interval)
        x = motion.at(t)[0] + step * rng.uniform() + scatter * rng.normal(size=t.size)
        fit = smooth(t, np.round(x / step) * step if step else x)
        assert fit.kinks.size == motion.jumps.size
        ratios.append((fit.kinks - motion.jumps) / fit.kink_sd)
    size = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all(size < 1.4)
    assert np.all(size > (0.7 if scatter else 0.3))


def test_a_jump_between_two_readings_is_anywhere_between_them():
    t = np.arange(0.0, 1.0, 0.01)
    fit = smooth(t, np.where(t < 0.5, 0.0, 1.0))
    assert fit.kink_sd == pytest.approx(np.full(fit.kinks.size, 0.01 / np.sqrt(12.0)), rel=1e-6)


def test_a_planned_motion_has_exact_kinks():
    motion = planned([Stroke(1.0, 2.0, 3.0)], 100.0)
    assert motion.kinks.size == 3
    assert np.all(motion.kink_sd == 0.0)
    assert motion.clock_sd == 0.0


def test_kinks_of_a_jittered_clock():
    motion = sharp(10.0, 0.2, 0.5 + 1e-4 * np.pi)
    t = sampled(motion, 1e-3)
    stamped = t + 4e-6 * np.random.default_rng(3).normal(size=t.size)
    exact, jittered = smooth(t, motion.at(t)[0]), smooth(stamped, motion.at(t)[0])
    assert exact.clock_sd == 0.0
    assert jittered.clock_sd == pytest.approx(4e-6, rel=0.3)
    assert np.all(np.abs(jittered.kinks - motion.jumps) < 4.0 * jittered.kink_sd)


GAPS = np.cumsum([*[1e-3] * 500, *[0.0123] * 300, 5.0, *[0.0123] * 300])  # two rates, and a gap
KEPT = np.sort(np.random.default_rng(2).choice(20_000, 900, replace=False))


@pytest.mark.parametrize(
    "stamps",
    [*(step * np.arange(1000) for step in (1e-3, 0.02, 1.0 / 37.0)), GAPS, 0.02 * KEPT,
     0.005 * np.round(np.arange(300) * 5.37)],
    ids=["1 ms", "20 ms", "27 ms", "two rates", "stored on change", "thinned"],
)  # fmt: skip
def test_stamps_of_an_even_clock_are_exact(stamps):
    assert clock_error(stamps) == 0.0


@pytest.mark.parametrize("jitter", [0.01, 0.05, 0.1])
def test_jitter_is_measured(jitter):
    t = 0.01 * np.arange(5000.0)
    t += 0.01 * jitter * np.random.default_rng(0).normal(size=t.size)
    assert clock_error(t) == pytest.approx(0.01 * jitter, rel=0.06)


def test_stamps_rounded_to_milliseconds_and_to_the_last_decimal():
    """The rounding errors of steps of 7.3 ms are even over a millisecond."""
    t = 7.3e-3 * np.arange(2000)
    assert clock_error(np.round(t, 3)) == pytest.approx(1e-3 / np.sqrt(12.0), rel=0.25)
    uneven = np.cumsum(np.random.default_rng(2).uniform(0.02, 0.9, 500))
    assert clock_error(np.round(uneven, 2)) == pytest.approx(0.01 / np.sqrt(12.0))
    assert last_decimal(np.array([0.25, 1.75])) == pytest.approx(0.01)
    assert last_decimal(np.array([3.0, 20.0])) == 1.0
    assert last_decimal(np.array([1.0 / 3.0])) == 0.0


def test_displacement_at_the_stamped_times_shows_that_stamps_are_exact():
    """Uneven stamps of an even clock would scatter the readings of a moving platen."""
    motion = triangle(4.0, 2)
    t = sampled(motion, 1e-2, jitter=0.1)
    assert clock_error(t) > 5e-4
    assert smooth(t, motion.at(t)[0]).clock_sd < 1e-5
    late = motion.at(t + 1e-3 * np.random.default_rng(5).normal(size=t.size))[0]
    assert smooth(t, late).clock_sd == pytest.approx(clock_error(t), rel=0.5)


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
        amplitude = own.amplitude_of[name]
        theta[amplitude.number] = 3.0 * amplitude.sd
    start = search.density.at(base, theta)
    for kind in (*EFFECTS, *FORMS):
        if kind.name in below or kind.name not in space.effects:
            continue
        more = base.plus(kind.name)
        other = space.parameters(more)
        one = shapes(space, start, other, kind.name)[0]
        amplitude = other.amplitude_of[kind.name]
        nothing, slight = one.copy(), one.copy()
        slight[amplitude.number] += 1e-9 * amplitude.sd
        forces = space.forces(more, other.constants(np.stack([nothing, slight])))
        assert np.max(np.abs(forces[1] - forces[0])) < 1e-6 * peak, kind.name


@pytest.mark.parametrize("aligned", [0.0, 3e-4])
def test_a_drag_that_begins_at_the_contact_is_averaged_over_no_step(aligned):
    """Of readings at the contact itself nobody knows the side: they count by the jump there."""
    time = np.arange(0.0, 6.0, 1e-3)
    way = np.interp(time, [1.0, 1.1, 1.2, 6.0], [-0.2, 1.8, 1.8, 1.8]) + 20.0 * aligned
    rng = np.random.default_rng(0)
    loading = (time >= 1.0) & (time < 1.1)
    force = 0.5 * np.maximum(way, 0.0) + 0.08 * ((way >= 0.0) & loading)
    noisy = force + 0.002 * rng.standard_normal(time.size)
    test = Test("v20", "p", time, np.round(way, 3), noisy, contact_sd=0.002)
    experiment = prepare(Pad("p", (test,), PAD))
    blocks = experiment.reduced(experiment.trials[0]).blocks
    contact = 1.01 - aligned
    sides = np.sign(np.stack([blocks.first, blocks.last]) - contact)
    assert not np.any((sides[0] < 0.0) & (sides[1] > 0.0))
    near = np.abs(blocks.first - contact) < 0.01
    assert np.max((blocks.timing * blocks.count)[near]) > 0.015  # of a jump of 0.08 N
    assert np.max(blocks.timing[blocks.last < contact - 0.005]) < 1e-3
