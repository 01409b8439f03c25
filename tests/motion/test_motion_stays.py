"""Fitted motions stay with their readings, and phases are those that an experimenter would name."""

from dataclasses import replace

import numpy as np
import pytest
from support.motions import rounded
from support.solids import kinds

from qlvbayes.motion.bounds import departure_of
from qlvbayes.motion.phases import find_phases
from qlvbayes.motion.sensor import encoder_step, tolerance
from qlvbayes.motion.trajectory import smooth
from qlvbayes.simulate.platen import Hold, Move, Platen

STEP = 1e-3


def press(t):
    return np.interp(t, [0.0, 0.5, 1.5, 2.0], [0.0, 0.0, 2.0, 2.0])


def overshot(t):
    s = np.maximum(t - 0.7, 0.0)
    ring = 0.06 * np.exp(-s / 0.03) * np.cos(s / 0.02)
    return np.where(t < 0.7, 2.06 * np.clip((t - 0.5) / 0.2, 0.0, 1.0), 2.0 + ring)


def phases(fit):
    return kinds(find_phases(fit))


@pytest.mark.parametrize("share", [0.05, 0.25, 0.5, 3.0])
def test_a_press_read_by_an_encoder_that_dithers(share):
    rng = np.random.default_rng(1)
    t = 0.02 * np.arange(2000)
    x = rounded(press(t) + share * STEP * rng.normal(size=t.size), STEP)
    fit = smooth(t, x)
    every = np.linspace(0.0, t[-1], 50_001)
    assert np.abs(fit.displacement(every) - press(every)).max() < 2.0 * STEP * max(1.0, share)
    assert fit.knots.size == 4
    assert phases(fit) == ["hold", "ramp", "hold"]
    assert fit.departure is None


def test_a_platen_that_overshoots_and_settles_holds_from_its_farthest_point():
    t = np.arange(0.0, 5.0, 1e-3)
    fit = smooth(t, rounded(overshot(t), STEP))
    assert phases(fit) == ["hold", "ramp", "hold"]
    assert fit.displacement(0.7) == pytest.approx(2.06, abs=0.01)  # the motion keeps it


@pytest.mark.parametrize("every", [1e-3, 5e-3, 2e-2])
def test_scatter_does_not_hide_what_follows_an_overshoot(every):
    """A few readings that are each within the scatter, but all on one side, are followed."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 9.0, every)
    noise = 0.004
    fit = smooth(t, overshot(t) + noise * rng.normal(size=t.size))
    off = fit.displacement(t) - overshot(t)
    for m in (1, 2, 4, 8):
        means = np.convolve(off, np.full(m, 1.0 / m), "valid")
        assert np.abs(means).max() < (1.0 + np.sqrt(2.0 * np.log(t.size))) * noise / np.sqrt(m)
    assert phases(fit) == ["hold", "ramp", "hold"]


def test_means_of_rounded_readings_have_the_roundings_step():
    t = np.arange(0.0, 2.0, 5e-5)
    x = rounded(press(t), 0.01)
    means = x.reshape(-1, 4).mean(axis=1)
    assert encoder_step(means) == pytest.approx(0.01)
    fit = smooth(t.reshape(-1, 4).mean(axis=1), means)
    assert fit.knots.size < 10
    assert np.abs(fit.displacement(t) - press(t)).max() < 0.01


@pytest.mark.parametrize("every", [2e-4, 5e-4, 1e-3, 2e-3, 5e-3])
def test_scatter_of_a_motion_that_turns_ten_times_is_no_motion(every):
    """A quarter of a step, which seldom moves a reading by more than rounding may."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 9.0, every)
    true = np.interp(t, np.arange(0.0, 10.0, 1.5), [0.0, 2.0] * 3 + [0.0])
    fit = smooth(t, rounded(true + 0.25 * STEP * rng.normal(size=t.size), STEP))
    assert fit.knots.size < 20
    assert np.abs(fit.displacement(t) - true).max() < 2.0 * STEP


def test_few_readings_at_corners_are_not_taken_for_scatter():
    t = np.arange(0.15, 9.0, 0.4)
    x = np.interp(t, [0.0, 0.5, 1.5, 5.0, 6.0, 9.0], [0.0, 0.0, 2.0, 2.0, 0.0, 0.0])
    assert np.abs(smooth(t, x).displacement(t) - x).max() <= 2e-4 * 2.0


def departed(residual, noise=0.0, step=STEP):
    tol = replace(tolerance(np.arange(200.0), np.linspace(0.0, 1.0, 200), step), noise=noise)
    tol = replace(tol, spread=4.0 * noise, sample=0.5 * step + 4.0 * noise)
    return departure_of(np.arange(200.0), residual, tol)


def test_a_reading_two_steps_from_the_motion_is_told():
    residual = np.zeros(200)
    residual[50] = 1.9 * STEP
    assert departed(residual) is None
    residual[50] = 2.1 * STEP
    found = departed(residual)
    assert (found.time, found.readings) == (50.0, 1)
    assert found.distance == pytest.approx(2.1 * STEP)
    assert "50 s" in found.notice("a", "mm")


def test_a_run_of_readings_is_told_that_each_alone_could_be_scatter():
    scatter = STEP * np.random.default_rng(6).normal(size=200)
    assert departed(scatter, noise=STEP, step=0.0) is None
    scatter[100:116] += 3.0 * STEP
    found = departed(scatter, noise=STEP, step=0.0)
    assert 100.0 <= found.time < 116.0
    assert f"mean of {found.readings} readings" in found.notice("a", "mm")


INTERVAL = 0.02  # s
LIMIT = 1000.0  # mm/s2


FINE = np.linspace(-0.1, 0.3, 4001)
OFFSETS = pytest.mark.parametrize("offset", [0.0, 0.004, 0.011, 0.017])
RATES = pytest.mark.parametrize("rate", [20.0, 30.0, 50.0, 100.0])


def quick_press(rate, offset, creep=0.0):
    """The way of a press to 1.6 mm; times of readings, ``offset`` (s) before one it begins."""
    platen = Platen((Move(1.6, rate), Hold(5.0, creep)), LIMIT)
    return lambda t: np.where(t < 0.0, 0.0, platen.displacement(np.maximum(t, 0.0))), (
        np.arange(-10, 250) * INTERVAL + offset
    )


@pytest.mark.parametrize("creep", [0.0, 4e-4])
@OFFSETS
@RATES
@pytest.mark.few(5)
def test_a_press_of_three_to_five_readings_goes_where_the_platen_went(rate, offset, creep):
    """And nothing overshoots that no reading shows."""
    true, time = quick_press(rate, offset, creep)
    found = smooth(time, true(time))
    path = found.displacement(FINE)
    assert path.max() < 1.6 + 1e-3
    assert np.all(np.diff(path) > -1e-3)
    if not creep:
        assert np.max(np.abs(path - true(FINE))) < 0.01 * 1.6
        assert not found.acceleration_resolved  # the gentlest way was taken


@pytest.mark.parametrize(("rate", "offset", "creep"), [(100.0, 0.004, 0.2), (30.0, 0.017, 0.02)])
def test_a_creep_after_a_quick_press_keeps_its_speed(rate, offset, creep):
    """What few readings of the press leave open is no reason to follow the encoder's steps."""
    true, time = quick_press(rate, offset, creep)
    x = true(time)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(x.size)
    found = smooth(time, np.round(x + noise, 3))
    speed = creep / 5.0  # mm/s, over the hold of `quick_press`
    off = found.velocity(np.linspace(0.3, 4.5, 5001)) - speed
    assert np.max(np.abs(off)) < 0.05 * speed
