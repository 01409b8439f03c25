"""A channel that is read more slowly than the rows; stairs and coarse steps are none such."""

from dataclasses import replace

import numpy as np
import pytest
from support.solids import kinds, made_ready, solid

from qlvbayes.io.data import Test
from qlvbayes.motion.polling import fresh_forces, repeated_rows

# the displacement is repeated

RATE, NOISE = 50.0, 1e-3  # rows a second, N
PRESS = ([0.5, 1.5, 20.0, 22.5, 30.0], [0.0, 2.0, 2.0, 0.5, 0.5])
ORDINALS = {2: "2nd", 3: "3rd", 5: "5th", 10: "10th"}


def repeated(values, rows, first=0):
    """Keep the reading of each so many-th row until the next; the rows before repeat the first."""
    return values[np.maximum((np.arange(values.size) - first) // rows * rows + first, 0)]


def a_test(displacement, way, name="press", repeat=1):
    """The readings of a displacement, with the force of what it truly was."""
    time = np.arange(way.size) / RATE
    noise = NOISE * np.random.default_rng(1).standard_normal(time.size)
    force = solid(time, way, 0.5, 0.5, 2.0) + noise
    return Test(name, "p", time, displacement, repeated(force, repeat))


def pressed(course=PRESS, until=30.0, step=1e-4):
    time = np.arange(0.0, until, 1.0 / RATE)
    x = np.interp(time, *course)
    return time, x, np.round(x / step) * step


def moved(trial):
    return kinds(trial.phases[trial.phases[0].kind == "hold" :])


@pytest.mark.parametrize(("rows", "first"), [(2, 1), (3, 0), (5, 0), (10, 0), (10, 7)])
@pytest.mark.few(3)
def test_the_motion_goes_smoothly_between_the_readings_of_a_slow_encoder(rows, first):
    time, x, read = pressed()
    experiment = made_ready(a_test(repeated(read, rows, first), x))
    (trial,) = experiment.trials
    assert moved(trial) == ["ramp", "hold", "unload", "recovery"]
    off = np.abs(trial.trajectory.displacement(time) - x)
    to_corner = np.min(np.abs(time[:, None] - np.array(PRESS[0])), axis=1)
    assert np.max(off[to_corner > rows / RATE]) < 5e-4
    assert np.max(off) < 0.3 * 2.0 * rows / RATE  # at 2 mm/s no reading shows when it stopped
    assert np.max(np.abs(trial.test.displacement - x)) == pytest.approx(np.max(off), abs=2e-4)
    (notice,) = [text for text in experiment.notices if "row" in text]
    assert f"in test press the displacement is read only every {ORDINALS[rows]} row" in notice


def test_a_quick_test_is_read_as_the_slow_one_of_its_pad():
    _, x, read = pressed()
    slow = a_test(repeated(read, 10), x, "slow")
    _, x, read = pressed(([0.5, 0.8], [0.0, 2.0]))
    quick = a_test(repeated(read, 10), x, "quick")
    trials = made_ready(slow, quick).trials
    assert repeated_rows(quick) == 0  # two changes alone show no period
    assert moved(trials[1]) == ["ramp", "hold"]
    assert trials[1].phases[0].stop == pytest.approx(0.8, abs=0.11)


def test_a_lost_reading_of_force_leaves_the_period():
    _, x, read = pressed()
    test = a_test(repeated(read, 10), x)
    test.force[1200] = 9.99
    (trial,) = made_ready(test).trials
    assert trial.left_out.count == 1
    assert moved(trial) == ["ramp", "hold", "unload", "recovery"]


@pytest.mark.parametrize("speed", [0.05, 0.12, 0.5, 1.0])
def test_stairs_of_a_coarse_encoder_are_no_repeats(speed):
    """Two speeds, a cosine, and one exactly steady speed, with steps of 0.02 mm."""
    ways = np.array([0.5, 0.5 + 1.0 / speed, 5.0 + 1.0 / speed, 5.0 + 1.4 / speed])
    time, x, read = pressed((ways, [0.0, 1.0, 1.0, 2.0]), ways[-1] + 5.0, step=0.02)
    assert repeated_rows(a_test(read, x)) == 0
    cosine = 1.0 - np.cos(2.0 * np.pi * speed * time / 4.0)
    assert repeated_rows(a_test(np.round(cosine / 0.02) * 0.02, cosine)) == 0
    _, x, read = pressed(([0.5, 0.5 + 2.0 / speed], [0.0, 2.0]), step=0.02)
    assert repeated_rows(a_test(read, x)) == 0


@pytest.mark.parametrize("rows", [10, 100])
def test_steps_between_which_the_platen_stands_and_rows_written_twice_are_no_repeats(rows):
    """The force jumps with each step and relaxes until the next."""
    stairs = np.minimum(np.arange(1500) // rows, 12) * 0.1
    uneven = np.cumsum(np.where(np.arange(1500) % rows == 0, 0.05 + np.arange(1500) / 1e4, 0.0))
    for x in (stairs, uneven):
        assert repeated_rows(a_test(x, x)) == 0
    _, x, read = pressed()
    assert repeated_rows(a_test(repeated(read, 5), x, repeat=5)) == 0


# the force is repeated: only its first row counts

SLOW = ([0.0, 0.5, 4.1, 12.0, 13.6, 17.0], [-0.2, -0.2, 1.6, 1.6, 0.8, 0.8])
QUICK = ([0.0, 0.5, 0.86, 9.0, 9.2, 13.0], [-0.2, -0.2, 1.6, 1.6, 0.8, 0.8])
CELL = 3e-3  # N, white noise of the load cell
JITTER = [
    np.random.default_rng(k).integers(*ends, 3000) for k, ends in enumerate([(7, 14), (2, 7)])
]


def touched(course, seed, name="press"):
    """A solid pressed from 0 on, read a hundred times a second."""
    time = np.arange(0.0, course[0][-1], 0.01)
    displacement = np.interp(time, *course)
    noise = CELL * np.random.default_rng(seed).standard_normal(time.size)
    force = solid(time, np.maximum(displacement, 0.0), 0.4, 0.4, 0.5) + noise
    return Test(name, "p", time, displacement, np.round(force, 4))


def held(test, lengths):
    """Repeat each reading of the force for so many rows; also return the first row of each."""
    first = np.cumsum([0, *(lengths if np.ndim(lengths) else [lengths] * 3000)])
    first = first[first < test.time.size]
    last = first[np.searchsorted(first, np.arange(test.time.size), "right") - 1]
    return replace(test, force=test.force[last]), first


@pytest.mark.parametrize("lengths", [2, 3, 10, 25, *JITTER])
@pytest.mark.few(3)
def test_only_the_first_row_of_each_repeat_counts(lengths):
    tests, firsts = zip(*(held(touched(SLOW, k, f"t{k}"), lengths) for k in (1, 2)), strict=True)
    experiment = made_ready(*tests)
    for trial, test, first in zip(experiment.trials, tests, firsts, strict=True):
        assert np.count_nonzero(~np.isin(trial.test.time, test.time[first])) <= 0.02 * first.size
        assert np.count_nonzero(~np.isin(test.time[first], trial.test.time)) <= 0.02 * first.size
        assert kinds(trial.phases) == ["hold", "ramp", "hold", "unload", "recovery"]
    assert experiment.floor.total == pytest.approx(CELL, rel=0.35)
    assert experiment.floor.ou < 0.7 * CELL
    assert sum("read only about every" in text for text in experiment.notices) == 2


@pytest.mark.parametrize("courses", [(SLOW, QUICK), (QUICK,)])
def test_a_quick_test_shows_it_beside_others_and_where_the_platen_rests(courses):
    tests = [held(touched(course, k + 1, f"t{k}"), 10)[0] for k, course in enumerate(courses)]
    for test, mask in zip(tests, fresh_forces(tests), strict=True):
        assert mask is not None
        assert np.count_nonzero(mask) == pytest.approx(test.time.size / 10, rel=0.02)


@pytest.mark.parametrize("step", [1e-4, 0.01, 0.03, 0.1])
@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("course", [SLOW, QUICK])
@pytest.mark.few(4)
def test_a_converter_however_coarse_is_read_in_every_row(step, noise, course):
    test, other = touched(course, 3), touched(course, 4)
    force = other.force + noise * (test.force - other.force)
    assert fresh_forces([replace(test, force=np.round(force / step) * step)]) == [None]


def test_stairs_taken_within_one_row_and_no_force_before_contact_are_no_repeats():
    time = np.arange(0.0, 60.0, 0.01)
    stairs = np.minimum(np.floor(time / 2.0), 25.0) * 0.1
    force = np.round((stairs * 0.5 + 0.05 * np.exp(-(time % 2.0)) * (stairs > 0.0)) / 0.02) * 0.02
    assert fresh_forces([Test("s", "p", time, stairs, force)]) == [None]
    test = touched(SLOW, 1)
    sphere = 0.5 * np.maximum(test.displacement, 0.0) ** 1.5
    assert fresh_forces([replace(test, force=sphere)]) == [None]
