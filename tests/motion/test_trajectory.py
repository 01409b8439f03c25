"""Fitted motions against platens of limited acceleration, in any unit, and what they never do."""

import time as clock
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from support.motions import LIMIT, rounded, sampled, trapezoids

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.motion import experiment
from qlvbayes.motion.phases import find_phases
from qlvbayes.motion.sensor import encoder_step, known_scatter
from qlvbayes.motion.trajectory import smooth

PADS = Path(__file__).parents[2] / "data" / "pads.csv"
STEP = 1e-3  # mm
read = partial(rounded, step=STEP)
THERE_AND_BACK = trapezoids((20.0, 1.0), (1.6, -1.6), hold=30.0, lead=0.0203)


def rig(rng, speed, rest=1.0):
    """A ramp and hold whose kinks and encoder zero fall anywhere between samples and steps."""
    motion = trapezoids(speed, hold=rest, lead=0.05 + rng.uniform(0.0, 1e-3))
    return motion, np.arange(0.0, motion.duration, 1e-3), rng.uniform(0.0, STEP)


def clear(motion, t):
    """Away from all kinks."""
    return np.min(np.abs(t[:, None] - motion.jumps), axis=1) > 3e-3


def assert_rates(fit, motion, t):
    _, v, a = motion.at(t)
    away = clear(motion, t)
    assert np.abs(fit.velocity(t) - v)[away].max() < 0.02 * v.max()
    assert np.abs(fit.acceleration(t) - a)[away].max() < 0.10 * LIMIT


@pytest.mark.parametrize("speed", [20.0, 100.0])
def test_velocity_and_acceleration_away_from_the_kinks(speed):
    rng = np.random.default_rng(int(speed))
    for _ in range(6):
        motion, t, offset = rig(rng, speed)
        assert_rates(smooth(t, read(motion.at(t)[0], offset=offset)), motion, t)


@pytest.mark.parametrize("speed", [0.1, 0.3, 1.0, 3.0, 10.0, 30.0])
@pytest.mark.few(3)
def test_cruising_speed_at_the_other_rates(speed):
    rng = np.random.default_rng(3)
    for _ in range(2 if speed < 1.0 else 4):
        # Near whole steps per sample the readings beat with the encoder.
        motion, t, offset = rig(rng, speed * (1.0 + rng.choice([0.0, 1e-3, -1e-3, 0.03])))
        fit = smooth(t, read(motion.at(t)[0], offset=offset))
        begin, end = motion.jumps[1:3]  # between its ramps of speed
        middle = np.linspace(begin + 0.25 * (end - begin), end - 0.25 * (end - begin), 50)
        assert np.allclose(fit.velocity(middle), motion.at(middle)[1], rtol=0.02)


def test_displacement_within_one_step_of_the_truth_at_any_speed():
    rng = np.random.default_rng(8)
    for _ in range(6):
        motion, t, offset = rig(rng, np.exp(rng.uniform(np.log(0.5), np.log(100.0))), rest=0.3)
        x = motion.at(t)[0] + offset
        assert np.abs(smooth(t, read(x)).displacement(t) - x).max() < STEP


def test_holds_are_exactly_constant_the_step_is_found_and_the_cost_grows_with_the_readings():
    t = sampled(THERE_AND_BACK, 1e-3)
    x = read(THERE_AND_BACK.at(t)[0], offset=0.0003)
    assert t.size > 60_000
    begin = clock.process_time()
    fit = smooth(t, x)
    assert clock.process_time() - begin < 2.0
    assert fit.resolution == pytest.approx(STEP, rel=1e-6)
    for begin, end in (THERE_AND_BACK.jumps[[3, 4]], (THERE_AND_BACK.jumps[-1], t[-1])):
        rest = np.linspace(begin + 5e-3, end - 5e-3, 1000)
        assert np.ptp(fit.displacement(rest)) == 0.0
        assert np.all(fit.velocity(rest) == 0.0)
    assert fit.knots.size <= 9


def test_sensor_noise_instead_of_steps():
    rng = np.random.default_rng(5)
    motion = trapezoids(20.0, (1.6, -1.6), hold=3.0, lead=0.1)
    t = sampled(motion, 1e-3)
    x, v, _ = motion.at(t)
    for _ in range(2):
        fit = smooth(t, x + 1e-3 * rng.normal(size=t.size))
        assert fit.resolution == 0.0
        assert np.abs(fit.displacement(t) - x).max() < 3e-3
        assert np.abs(fit.velocity(t) - v)[clear(motion, t)].max() < 0.03 * 20.0
        assert fit.velocity(np.array([1.0, 2.0])) == pytest.approx([0.0, 0.0], abs=0.0)


def test_a_thinned_record_keeps_the_ramp():
    motion = trapezoids(20.0, hold=30.0, lead=0.0204)
    t = np.arange(0.0, 30.0, 1e-3)
    rows = np.unique(np.concatenate([np.arange(150), np.geomspace(150, t.size - 1, 350)]))
    t = t[rows.astype(int)]
    assert_rates(smooth(t, read(motion.at(t)[0], offset=0.0002)), motion, t)


@pytest.mark.parametrize("begin", [0.1, 0.104, 0.108, 0.113, 0.117])
@pytest.mark.parametrize("speed", [10.0, 20.0, 100.0])
@pytest.mark.few(2)
def test_stairs_too_quick_for_the_readings_are_no_scatter(speed, begin):
    """One or two readings a stair: an estimate of scatter that takes them for it follows none."""
    motion = trapezoids(speed, (0.4, 0.4, 0.4, 0.4, -0.8), hold=3.3, lead=begin)
    t = sampled(motion, 0.02)
    x = read(motion.at(t)[0])
    fit = smooth(t, x, STEP)
    assert np.abs(fit.displacement(t) - x).max() <= STEP
    standing = np.abs(motion.at(t - 0.02)[0] - motion.at(t + 0.02)[0]) < 1e-9
    assert np.all(fit.velocity(t[standing & (t > 0.02)]) == 0.0)


def test_a_few_stairs_of_one_size_are_not_the_encoders():
    t = np.arange(0.0, 20.0, 0.02)
    stairs = np.interp(t, [3.0, 3.04, 7.0, 7.04, 11.0, 11.04], [0.0, 0.4, 0.4, 0.8, 0.8, 1.2])
    assert set(np.round(np.diff(stairs), 12)) == {0.0, 0.2}
    assert encoder_step(stairs) == 0.0
    ramp = np.round(np.linspace(0.0, 20.0, t.size)) * 0.2
    assert encoder_step(np.concatenate([ramp, ramp[::-1]])) == 0.2


def test_few_readings_do_not_take_turns_for_scatter():
    """Five readings a stroke show none; the slow record of the same sensor does."""
    times, paths = [], []
    for speed, every in ((0.5, 0.02), (20.0, 0.017)):
        motion = trapezoids(speed, (0.8, -0.8) * 4, hold=0.0, lead=0.1)
        times.append(sampled(motion, every))
        paths.append(read(motion.at(times[-1])[0]))
    bounds = known_scatter(times, paths, [STEP, STEP])
    assert bounds == [np.inf, 0.0]
    for most in bounds:
        fit = smooth(times[1], paths[1], STEP, most)
        assert np.abs(fit.displacement(times[1]) - paths[1]).max() <= STEP


@pytest.mark.parametrize("left", [0, 1, 2])
def test_a_move_of_which_a_logger_lost_nearly_all_readings(left):
    """It lies between the last reading at rest and the first one after it, and only rises."""
    motion, t, _ = rig(np.random.default_rng(0), 20.0)
    x = motion.at(t)[0]
    lost = (t > motion.jumps[0]) & (t < motion.jumps[3])
    lost[np.flatnonzero((x > 0.2 * x.max()) & (x < 0.8 * x.max()))[:left]] = False
    fit = smooth(t[~lost], x[~lost])
    assert np.abs(fit.displacement(t[~lost]) - x[~lost]).max() < 0.01 * x.max()
    within = np.flatnonzero(lost)
    across = fit.displacement(np.linspace(t[within[0]], t[within[-1]], 200))
    assert np.all(np.diff(across) > -1e-3 * x.max())


def test_nothing_happens_in_a_gap_beside_a_rest():
    """A thinned record keeps few readings of a hold, and the last one long before it ends."""
    late = np.linspace(0.0, 1.0, 300)
    rise = 10.0 * late**3 - 15.0 * late**4 + 6.0 * late**5
    t = np.concatenate([[0.0, 0.5, 1.0, 1.5, 2.0, 4.0, 5.0], 8.0 + late[1:], [9.5, 10.0, 12.0]])
    x = np.concatenate([np.full(7, 2.0), 2.0 - 1.5 * rise[1:], np.full(3, 0.5)])
    every = np.linspace(0.0, 12.0, 5001)
    found = smooth(t, x).displacement(every)
    assert found.max() < 2.001
    assert found.min() > 0.499
    assert np.abs(found[(every > 5.0) & (every < 7.9)] - 2.0).max() < 1e-3


def test_no_knot_is_left_to_itself_between_readings():
    """Turning points of thinned triangles: straight lines follow the readings there."""
    t = np.arange(0.0, 4.0, 1e-3)
    triangle = read(1.6 * np.abs((t % 1.0) * 2.0 - 1.0), offset=0.5 * STEP)
    rng = np.random.default_rng(3)
    for _ in range(3):
        kept = np.sort(rng.choice(t.size, 300, replace=False))
        fit = smooth(t[kept], rounded(triangle[kept], 0.005))
        assert np.abs(fit.displacement(t) - triangle).max() < 0.2


@pytest.mark.parametrize("seed", [0, 2])
@pytest.mark.few(1)
def test_a_creep_stays_smooth_where_its_load_jumps(seed):
    """Lines replace the pieces that leave the readings, not the motion of the whole record."""
    t = np.arange(0.0, 84.0, 0.02)
    on, off = (np.clip((t - begin) / 0.1, 0.0, 1.0) for begin in (2.0, 42.0))
    load = on**2 * (3.0 - 2.0 * on) - 0.7 * off**2 * (3.0 - 2.0 * off)
    creep = 0.4 * load
    for compliance, tau in ((0.15, 0.3), (0.2, 3.0), (0.2, 25.0)):
        share = 1.0 - np.exp(-0.02 / tau)
        creep += compliance * lfilter([share], [1.0, share - 1.0], load)
    noise = np.random.default_rng(seed).normal(0.0, STEP, t.size)
    error = smooth(t, rounded(creep + noise, 0.1 * STEP)).displacement(t) - creep
    assert np.sqrt(np.mean(error**2)) < 0.5 * STEP
    assert np.abs(error).max() < 8.0 * STEP  # where the load jumps in five readings


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.few(1)
def test_a_few_scattered_readings_are_never_left_far(seed):
    rng = np.random.default_rng(seed)
    for _ in range(4):
        t = np.cumsum(rng.uniform(0.01, 1.0, size=10))
        x = np.cumsum(rng.normal(size=10))
        assert np.abs(smooth(t, x).displacement(t) - x).max() <= 0.05 * np.ptp(x) + 1e-12


coefficient = st.floats(-10.0, 10.0).map(lambda c: round(c, 3))


@settings(max_examples=10, deadline=None)
@given(coefficient, coefficient, coefficient, st.integers(10, 150))
@example(3.0, -0.5, 0.5, 32)  # turns between two readings whose line it leaves by more than they
@example(0.0, -0.5, 6.0, 68)  # differ
@example(8.626, 1.943, -1.173, 18)
@example(0.0, 4.75, -7.5, 101)  # a reading moves next to nothing before it turns
def test_parabolas_are_reproduced(a, b, c, n):
    t = np.sort(np.random.default_rng(n).uniform(0.0, 1.0, size=n))
    x = a + b * t + c * t**2
    assert np.abs(smooth(t, x).displacement(t) - x).max() <= 1e-5 * np.ptp(x) + 1e-12


@settings(max_examples=6, deadline=None)
@given(st.integers(-3, 3), st.integers(-3, 3), st.integers(-6, 6), st.integers(0, 99))
def test_units_of_time_and_depth_do_not_matter(slower, larger, later, seed):
    motion, t, offset = rig(np.random.default_rng(seed), 20.0, rest=0.2)
    x = read(motion.at(t)[0], offset=offset)
    # Powers of two keep the readings exact.
    time_unit, depth_unit, shift = 2.0**slower, 2.0**larger, 0.125 * later
    plain = smooth(t, x)
    scaled = smooth(time_unit * t + shift, depth_unit * x)
    where = 0.5 * (t[1:] + t[:-1])
    away = np.min(np.abs(where[:, None] - plain.knots[None, :]), axis=1) > 5e-4
    v = scaled.velocity(time_unit * where + shift) * time_unit / depth_unit
    assert np.abs(v - plain.velocity(where))[away].max() < 1e-2


@pytest.mark.parametrize("unit", [1e-3, 1e3, 1e6, 25.4])
@pytest.mark.few(2)
def test_the_bundled_motions_are_the_same_in_any_unit(unit):
    """Their encoder's steps are whole numbers in some units, and round either way in others."""
    for test in read_measurements(PADS).pad("B").tests[::2]:
        plain = experiment.smooth(test.time, test.displacement)
        scaled = smooth(test.time, np.round(test.displacement / STEP) * (STEP * unit))
        off = scaled.displacement(test.time) / unit - plain.displacement(test.time)
        assert np.abs(off).max() < 0.5 * STEP
        assert len(find_phases(scaled)) == len(find_phases(plain))


@pytest.mark.parametrize(
    ("t", "x"),
    [([0.0, 1.0], [0.0]), ([0.0], [0.0]), ([0.0, 0.0], [0.0, 1.0]), ([0.0, 1.0], [0.0, np.nan])],
)
def test_unusable_records_are_refused(t, x):
    with pytest.raises(InputError):
        smooth(t, x)
