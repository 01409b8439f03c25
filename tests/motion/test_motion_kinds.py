"""Velocity, acceleration and stated error on every kind of motion, against closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from support.motions import (
    hand,
    read,
    s_curves,
    sampled,
    sine,
    stairs_that_creep,
    trapezoids,
    triangle,
    uneven,
)
from support.solids import kinds

from qlvbayes.motion.phases import find_phases, loading_rate
from qlvbayes.motion.sensor import encoder_step, encoder_steps
from qlvbayes.motion.trajectory import smooth

STEPS = [0.0, 1e-4, 1e-3, 1e-2]  # mm
JITTERS = [0.0, 0.01, 0.1]  # of the interval between samples

# motion, sampling interval in s
SMOOTH = {
    "sine, 20 a cycle": (sine(1.0, 8), 0.05),
    "sine of 0.03 Hz, 37 a cycle": (sine(0.03, 8), 1.0 / 37.0 / 0.03),
    "sine of 3 Hz at 1 kHz": (sine(3.0, 8), 1e-3),
    "one slow cycle at 1 kHz": (sine(0.05, 1), 1e-3),
    "sine from the middle": (sine(1.0, 6, phase=0.4), 1e-2),
    "sine after a rest": (sine(1.0, 6, lead=2.0), 1e-2),
    "by hand": (hand(1), 1e-2),
    "by hand, sparse": (hand(2), 3e-2),
}
KINKED = {
    "trapezoid, 10 mm/s": (trapezoids(10.0, (1.6, -1.6)), 1e-3),
    "trapezoid, 100 mm/s": (trapezoids(100.0, (1.6, -1.6)), 1e-3),
    "triangle, finite turns": (triangle(1.0, 8, 0.1), 5e-3),
    "staircase": (trapezoids(10.0, (0.4, 0.4, 0.4, -0.4, -0.4, -0.4), hold=2.0), 1e-3),
    "staircase that creeps": (stairs_that_creep(), 1e-3),
}
SHARP = {
    "triangle, 20 a cycle": (triangle(1.0, 8), 0.0501),
    "triangle at 1 kHz": (triangle(1.0, 4), 1e-3),
    "trapezoid, 0.1 mm/s": (trapezoids(0.1, (1.6, -1.6)), 2e-2),
}
JERKED = {
    "S-curve, 10 mm/s": (s_curves(10.0, 5e4, (1.6, -1.6)), 1e-3),
    "S-curve, 1 mm/s": (s_curves(1.0, 1e3, (1.6, -1.6)), 1e-3),
}


class Seen:
    """A motion, its record, its fit, and the errors where they count."""

    def __init__(self, motion, t, step):
        self.t = t
        x, v, a = motion.at(t)
        reading, offset = read(x, step)
        self.fit = smooth(t, reading)
        use = motion.away(t, 2, step) & (np.abs(v) > 1e-3 * np.abs(v).max())
        self.speed = (self.fit.velocity(t) - v)[use] / np.abs(v).max()
        peak = max(float(np.abs(a).max()), 1e-9)  # sharp turns have none
        self.rate = (self.fit.acceleration(t) - a)[use] / peak
        self.depth = self.fit.displacement(t) - x - offset


def rms(y):
    return float(np.sqrt(np.mean(y**2)))


def within(errors, share):
    return rms(errors) < share and np.quantile(np.abs(errors), 0.95) < share


def table(kinds):
    return pytest.mark.parametrize(("motion", "interval"), kinds.values(), ids=kinds.keys())


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("jitter", JITTERS)
@table(SMOOTH | KINKED)
@pytest.mark.few(14)
def test_velocity_within_2_and_acceleration_within_10_per_cent_and_an_honest_error(
    motion, interval, jitter, step, request
):
    """The stated error is within a factor 2 of that of a single record."""
    if "creeps" in request.node.name and step == 0.01 and jitter == 0.0:
        pytest.xfail("a hold that creeps by half an encoder step may be taken for a movement")
    seen = Seen(motion, sampled(motion, interval, jitter), step)
    assert within(seen.speed, 0.02)
    assert within(seen.rate, 0.10)
    assert seen.fit.velocity_resolved
    assert seen.fit.acceleration_resolved
    if step and jitter != 0.01:
        sd = seen.fit.displacement_sd(seen.t)
        assert 0.1 * rms(sd) < rms(seen.depth) < 2.2 * rms(sd)
        assert np.all(sd > 0.0)


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("jitter", [0.0, 0.1])
@table(SHARP)
@pytest.mark.few(4)
def test_sharp_turns_show_the_velocity_and_no_acceleration(motion, interval, jitter, step):
    seen = Seen(motion, sampled(motion, interval, jitter), step)
    assert within(seen.speed, 0.02)
    assert seen.fit.velocity_resolved
    assert not seen.fit.acceleration_resolved
    assert "acceleration" in dict(seen.fit.unresolved)


@pytest.mark.parametrize("step", STEPS[:3])
@pytest.mark.parametrize("jitter", [0.0, 0.1])
@table(JERKED)
@pytest.mark.few(2)
def test_jerk_limited_moves(motion, interval, jitter, step):
    """Their acceleration is not held to 10 %: pieces of constant acceleration describe them too."""
    seen = Seen(motion, sampled(motion, interval, jitter), step)
    assert within(seen.speed, 0.02)
    assert rms(seen.rate) < 0.15


def test_the_stated_error_over_many_records():
    """Its ratio to the true error is within 1.5, for sines whose encoder's zero lies anywhere."""
    motion = sine(1.0, 4)
    t = sampled(motion, 0.02)
    x = motion.at(t)[0]
    true, stated = [], []
    for seed in range(30):
        reading, offset = read(x, 2e-3, seed)
        fit = smooth(t, reading)
        true.append(rms(fit.displacement(t) - x - offset))
        stated.append(rms(fit.displacement_sd(t)))
    assert 1.0 / 1.5 < rms(np.array(true)) / rms(np.array(stated)) < 1.5


@pytest.mark.parametrize("step", [0.0, 1e-3])
def test_a_thinned_and_uneven_logger(step):
    motion = sine(0.5, 6)
    seen = Seen(motion, uneven(motion, 400), step)
    assert within(seen.speed, 0.02)
    assert within(seen.rate, 0.10)


def test_scatter_beside_rounding():
    """A sensor without steps that scatters by 1 um."""
    motion = sine(1.0, 8)
    t = sampled(motion, 1e-2)
    x, v, a = motion.at(t)
    fit = smooth(t, x + 1e-3 * np.random.default_rng(2).normal(size=t.size))
    assert within((fit.velocity(t) - v) / v.max(), 0.02)
    assert within((fit.acceleration(t) - a) / a.max(), 0.10)
    assert rms(fit.displacement(t) - x) < 2.0 * rms(fit.displacement_sd(t))


@pytest.mark.parametrize("step", STEPS)
@table({k: v for k, v in SMOOTH.items() if "sine" in k})
@pytest.mark.few(5)
def test_cycles_are_loading_and_unloading(motion, interval, step):
    t = sampled(motion, interval)
    fit = smooth(t, read(motion.at(t)[0], step)[0])
    found = kinds(find_phases(fit))
    moving = [kind for kind in found if kind in ("ramp", "unload")]
    assert all(a != b for a, b in pairwise(moving))
    # the rest it began with
    assert len(found) - len(moving) == (1 if motion.jumps.size else 0)
    v = motion.at(np.linspace(0.0, motion.duration, 20_001))[1]
    signs = np.sign(v[np.abs(v) > 1e-3 * v.max()])
    assert len(moving) == 1 + np.count_nonzero(np.diff(signs))


def test_the_loading_rate_of_a_sine_is_its_mean_speed_between_20_and_80_per_cent():
    motion = sine(0.3, 8)
    t = sampled(motion, 1.0 / 37.0 / 0.3)
    fit = smooth(t, read(motion.at(t)[0], 1e-3)[0])
    # cos goes from 0.6 to -0.6 in (pi - 2 arccos 0.6) / w
    expected = 0.6 * 1.6 * 2 * np.pi * 0.3 / (np.pi - 2.0 * np.arccos(0.6))
    assert loading_rate(fit, find_phases(fit)) == pytest.approx(expected, rel=0.01)


def test_one_encoder_reads_all_tests_of_a_pad():
    """A fast test changes by many steps at a time, too seldom to show one; exact ones have none."""
    step, t = 0.005, np.arange(0.0, 4.0, 0.02)
    slow = step * np.round(np.minimum(0.3 * t, 1.0) / step)
    fast = step * np.round(np.clip(12.5 * (t - 0.5), 0.0, 1.1) / step)
    other = np.sin(t)
    assert encoder_step(fast) == 0.0
    assert encoder_steps([fast, slow, other]) == pytest.approx([step, step, 0.0])
