"""A force that falls while the platen goes on is reported; the stiffness before it is known."""

import shlex
from dataclasses import replace

import numpy as np
import pytest
from blind.study import measured
from hypothesis import given
from hypothesis import strategies as st
from support.motions import steered

from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.motion import experiment
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.falling import falls_of, largest_stiffness
from qlvbayes.motion.phases import find_phases
from qlvbayes.motion.specimen import pull_notices
from qlvbayes.simulate import NOISES, TABLE_1, HiddenPad, paper_protocol, record_study

RATE = 20.0  # readings a second
NOISE = 0.01  # N


def a_pull(force_of, *, hold=0.0, seed=0):
    """A pad pulled at 1 mm/s for 20 s and held, its force a function of the displacement (mm)."""
    time = np.arange(0.0, 20.0 + hold, 1.0 / RATE)
    displacement = np.minimum(time, 20.0)
    noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
    force = force_of(displacement) * np.where(time < 20.0, 1.0, 0.7) + noise
    test = Test(name="pull", pad="strip", time=time, displacement=displacement, force=force)
    return Pad("strip", (test,), PAD)


def stretched(displacement):
    return 0.2 * displacement


def torn_at(*points):
    """Loses 1 N at each point, and goes on with the stiffness that it had."""
    return lambda x: stretched(x) - sum(np.where(x > point, 1.0, 0.0) for point in points)


def falls(pad):
    (trial,) = prepare(pad, keep_all_readings=True).trials
    return falls_of(trial.test, trial.trajectory, trial.phases)


def test_a_tear_is_reported_with_its_displacement_and_the_part_before_it():
    pad = a_pull(torn_at(12.0, 15.0))
    first, second = falls(pad)
    assert first.displacement == pytest.approx(12.0, abs=1.0 / RATE)
    assert second.displacement == pytest.approx(15.0, abs=1.0 / RATE)
    assert first.before - first.after == pytest.approx(1.0, abs=10.0 * NOISE)
    (notice,) = [one for one in prepare(pad).notices if "tear" in one]
    use = shlex.split(notice.split("--use ")[1])[0]
    kept = prepare(pad, use=[use])
    assert not any("tear" in one for one in kept.notices)
    assert kept.trials[0].test.displacement[-1] == pytest.approx(12.0, abs=2.0 / RATE)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.few(4)
def test_a_tear_is_one_fall_where_noise_lets_the_force_be_highest_before_it(seed):
    """The force hardly rises any more before the tear, so that any reading may be the highest."""
    (fall,) = falls(a_pull(lambda x: np.minimum(stretched(x), 2.0) - (x > 12.0), seed=seed))
    assert fall.displacement == pytest.approx(12.0, abs=1.0 / RATE)


def test_a_force_that_falls_with_the_speed_alone_is_no_fall():
    """Pressed by half a sine; a pure drag, and one relaxation time in a spring, lag behind it."""
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    displacement, speed = 1.0 - np.cos(0.2 * np.pi * time), np.sin(0.2 * np.pi * time)
    lagging = np.sin(0.2 * np.pi * time - 1.0)  # its peak is 1.6 s before that of the motion
    for force in (speed, lagging - lagging[0]):
        test = Test(name="sine", pad="p", time=time, displacement=displacement, force=force)
        assert falls(Pad("p", (test,), PAD)) == ()


def spoilt(seed=None):
    """A pull with a single bad reading, or with noise that is large for a while."""
    (test,) = a_pull(stretched).tests
    force = test.force.copy()
    if seed is None:
        force[300] = 0.0
    else:
        large = 1.0 * np.exp(-test.time / 2.0)
        force += large * np.random.default_rng(seed).standard_normal(test.time.size)
    return Pad("strip", (replace(test, force=force),), PAD)


@pytest.mark.parametrize("pad", [a_pull(stretched, hold=10.0), *map(spoilt, (None, 0, 4))])
def test_what_relaxes_a_bad_reading_and_noise_for_a_while_do_not_tear(pad):
    assert falls(pad) == ()


def falls_at(rate, time, displacement, force, seed=0):
    """The falls in a machine's readings: so many a second, an encoder of 1 um, a noise of 1 mN."""
    at = np.arange(0.0, time[-1], 1.0 / rate)
    scatter = 1e-3 * np.random.default_rng(seed).standard_normal(at.size)
    read = np.round(np.interp(at, time, displacement), 3)
    test = Test("press", "p", at, read, np.interp(at, time, force) + scatter)
    path = experiment.smooth(at, read, 1e-3)
    return falls_of(test, path, find_phases(path))


STEERED = pytest.mark.parametrize(
    ("speed", "ramp_up", "jerk"),
    [(1.0, 0.02, 0.0), (10.0, 0.05, 0.02), (10.0, 0.2, 0.0), (20.0, 0.2, 0.1)],
)


@STEERED
@pytest.mark.few(2)
def test_a_mass_that_is_moved_and_a_drag_that_ends_do_not_tear(speed, ramp_up, jerk):
    """In air and with a pad of 0.05 N/mm below it."""
    time, displacement, velocity, acceleration = steered(speed, ramp_up, jerk=jerk, back=5.0)
    below = 0.05 * displacement
    for force in (
        2e-4 * acceleration,  # N s2/mm
        5e-3 * acceleration,
        2e-4 * acceleration + below,
        5e-3 * acceleration + below,
        1.0 * velocity / speed + below,
    ):
        assert falls_at(100.0, time, displacement, force) == ()


@STEERED
@pytest.mark.few(2)
def test_a_pad_that_sticks_and_lets_go_does_not_tear(speed, ramp_up, jerk):
    """Drawn 1 mm off it pulls, and lets go at 0.5 mm; it is drawn to at 0.2 mm on the way in."""
    time, displacement, velocity, _ = steered(speed, ramp_up, jerk=jerk, back=6.0)
    depth = np.concatenate([displacement, displacement - 1.0 - displacement[-1]])
    both = np.arange(depth.size) * (time[1] - time[0])
    inward = np.concatenate([velocity, velocity]) >= 0.0
    held = np.where(inward, depth > -0.2, depth > -0.5)
    force = np.where(held, 0.4 * np.minimum(depth, 0.0) + 0.2 * np.maximum(depth, 0.0), 0.0)
    force = force - np.where(held & (depth < 0.0), 0.3, 0.0)
    assert falls_at(100.0, both, depth, force) == ()


@STEERED
@pytest.mark.parametrize(("loss", "mass"), [(0.2, 0.0), (0.2, 2e-4), (0.9, 0.0)])  # share, N s2/mm
@pytest.mark.few(5)
def test_a_tear_at_a_steady_speed_is_found_whatever_is_moved(speed, ramp_up, jerk, loss, mass):
    time, displacement, _, acceleration = steered(speed, ramp_up, jerk=jerk, stroke=20.0)
    torn = np.where(displacement > 12.0, 1.0 - loss, 1.0)
    force = 0.2 * torn * displacement + mass * acceleration
    (fall,) = falls_at(100.0, time, displacement, force)
    assert fall.displacement == pytest.approx(12.0, abs=2.0 * speed / 100.0)
    assert fall.before - fall.after == pytest.approx(loss * 2.4, abs=0.2 * speed / 20.0 + 0.02)


def a_way(force_of):
    """A pad without memory that is pressed to 1.6 mm and let go again."""
    way = np.linspace(0.0, 1.6, 400)
    displacement = np.concatenate([way, way[::-1]])
    return Test("1", "B", np.arange(800.0), displacement, force_of(displacement))


@given(m=st.floats(0.1, 10.0), b=st.floats(0.05, 2.5), sign=st.sampled_from([1.0, -1.0]))
def test_the_stiffness_lies_between_the_slopes_at_both_ends_of_the_last_quarter(m, b, sign):
    """Of an exponential pad, pressed or (as some cells count) pulled."""
    test = a_way(lambda d: sign * m / b * np.expm1(b * d))
    assert m * np.exp(b * 0.75 * 1.6) < largest_stiffness([test]) < m * np.exp(b * 1.6)


def test_the_stiffness_is_where_the_force_is_largest_and_a_secant_where_that_is_at_no_depth():
    """A pad that pulls back, as it leaves the platen, harder than it was pressed."""
    soft, hard = a_way(lambda d: 1.0 * d), a_way(lambda d: 3.0 * d)
    assert largest_stiffness([soft, hard]) == pytest.approx(3.0)
    soft.force[-1] = -4.0
    assert largest_stiffness([soft]) == pytest.approx(4.0 / 1.6)


@pytest.fixture(scope="module")
def pad():
    programs = {f"{rate:g}": paper_protocol(rate) for rate in (1.0, 20.0)}
    found = record_study({"B": HiddenPad(TABLE_1["B"])}, programs, NOISES["correlated"], 0, 500)
    return measured(found, "B")


def pulled(pad, share, test=1):
    """The same pulling by so much, over the peak of all, in the midst of one test's unloading."""
    trial, force = prepare(pad).trials[test], pad.tests[test].force.copy()
    unload = next(phase for phase in trial.phases if phase.kind == "unload")
    rows = np.flatnonzero((trial.test.time > unload.start) & (trial.test.time < unload.stop))
    sagitta = np.sin(np.linspace(0.0, np.pi, rows.size))
    force[rows] = -share * max(float(t.force.max()) for t in pad.tests) * sagitta / sagitta.max()
    tests = list(pad.tests)
    tests[test] = replace(tests[test], force=force)
    return prepare(replace(pad, tests=tuple(tests)))


def test_noise_about_zero_is_no_pull(pad):
    assert pull_notices(prepare(pad), bonded=False) == ()
    assert pull_notices(pulled(pad, 0.03), bonded=False) == ()


@pytest.mark.parametrize("test", [0, 1])
def test_the_lowest_pull_is_told_with_test_time_and_size_unless_the_specimen_may(pad, test):
    experiment = pulled(pad, 0.08, test)
    trial = experiment.trials[test]
    lowest = trial.test.time[int(np.argmin(trial.test.force))]
    (notice,) = pull_notices(experiment, bonded=False)
    assert f"at {lowest:.4g} s of test {trial.name} (8 % of the peak" in notice
    assert pull_notices(experiment, bonded=True) == ()
    assert pull_notices(experiment, bonded=False, effects=("adhesion",)) == ()
    assert len(pull_notices(experiment, bonded=False, effects=("inertia",))) == 1
