"""A displacement that is read every k-th row and repeated is no staircase; stairs are none such."""

import numpy as np
import pytest

from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.polling import repeated_rows

RATE = 50.0  # rows a second
NOISE = 1e-3  # N
MM = UnitSystem("mm", "N")
PRESS = ([0.5, 1.5, 20.0, 22.5, 30.0], [0.0, 2.0, 2.0, 0.5, 0.5])


def solid(time, displacement):
    """A standard linear solid, 0.5 + 0.5 e^{-t / 2 s}, read with some noise."""
    relaxing, steps = np.zeros(time.size), np.diff(displacement)
    keep = np.exp(-np.diff(time) / 2.0)
    for k, step in enumerate(steps):
        relaxing[k + 1] = keep[k] * relaxing[k] + np.sqrt(keep[k]) * step
    noise = NOISE * np.random.default_rng(1).standard_normal(time.size)
    return 0.5 * (displacement - displacement[0]) + 0.5 * relaxing + noise


def repeated(displacement, rows, first=0):
    """Keep the reading of each so many-th row until the next; the rows before repeat the first."""
    return displacement[
        np.maximum((np.arange(displacement.size) - first) // rows * rows + first, 0)
    ]


def a_test(displacement, force, name="press"):
    time = np.arange(displacement.size) / RATE
    return Test(name=name, pad="p", time=time, displacement=displacement, force=force)


def pressed(course=PRESS, until=30.0, step=1e-4):
    time = np.arange(0.0, until, 1.0 / RATE)
    x = np.interp(time, *course)
    return time, x, np.round(x / step) * step


def kinds(trial):
    return [phase.kind for phase in trial.phases if phase.start > 0.0 or phase.kind != "hold"]


@pytest.mark.parametrize(("rows", "first"), [(2, 1), (3, 0), (5, 0), (10, 0), (10, 7)])
def test_the_motion_goes_smoothly_between_the_readings_of_a_slow_encoder(rows, first):
    time, x, read = pressed()
    test = a_test(repeated(read, rows, first), solid(time, x))
    experiment = prepare(Pad("p", (test,), MM))
    (trial,) = experiment.trials
    assert kinds(trial) == ["ramp", "hold", "unload", "recovery"]
    off = np.abs(trial.trajectory.displacement(time) - x)
    to_corner = np.min(np.abs(time[:, None] - np.array(PRESS[0])), axis=1)
    assert np.max(off[to_corner > rows / RATE]) < 5e-4
    assert np.max(off) < 0.3 * 2.0 * rows / RATE  # at 2 mm/s no reading shows when it stopped
    assert np.max(np.abs(trial.test.displacement - x)) == pytest.approx(np.max(off), abs=2e-4)
    ordinal = {2: "2nd", 3: "3rd", 5: "5th", 10: "10th"}[rows]
    (notice,) = [text for text in experiment.notices if "row" in text]
    assert f"in test press the displacement is read only every {ordinal} row" in notice


def test_a_quick_test_is_read_as_the_slow_one_of_its_pad():
    time, x, read = pressed()
    slow = a_test(repeated(read, 10), solid(time, x), "slow")
    time, x, read = pressed(([0.5, 0.8], [0.0, 2.0]))
    quick = a_test(repeated(read, 10), solid(time, x), "quick")
    trials = prepare(Pad("p", (slow, quick), MM)).trials
    assert repeated_rows(quick) == 0  # two changes alone show no period
    assert kinds(trials[1]) == ["ramp", "hold"]
    assert trials[1].phases[0].stop == pytest.approx(0.8, abs=0.11)


def test_a_lost_reading_of_force_leaves_the_period():
    time, x, read = pressed()
    force = solid(time, x)
    force[1200] = 9.99
    (trial,) = prepare(Pad("p", (a_test(repeated(read, 10), force),), MM)).trials
    assert trial.left_out.count == 1
    assert kinds(trial) == ["ramp", "hold", "unload", "recovery"]


@pytest.mark.parametrize("speed", [0.05, 0.12, 0.5, 1.0])
def test_stairs_of_a_coarse_encoder_are_no_repeats(speed):
    """Two speeds, a cosine, and one exactly steady speed, with steps of 0.02 mm."""
    ways = np.array([0.5, 0.5 + 1.0 / speed, 5.0 + 1.0 / speed, 5.0 + 1.4 / speed])
    time, x, read = pressed((ways, [0.0, 1.0, 1.0, 2.0]), ways[-1] + 5.0, step=0.02)
    assert repeated_rows(a_test(read, solid(time, x))) == 0
    cosine = 1.0 - np.cos(2.0 * np.pi * speed * time / 4.0)
    assert repeated_rows(a_test(np.round(cosine / 0.02) * 0.02, solid(time, cosine))) == 0
    time, x, read = pressed(([0.5, 0.5 + 2.0 / speed], [0.0, 2.0]), step=0.02)
    assert repeated_rows(a_test(read, solid(time, x))) == 0


@pytest.mark.parametrize("rows", [10, 100])
def test_steps_between_which_the_platen_stands_are_no_repeats(rows):
    """The force jumps with each step and relaxes until the next."""
    stairs = np.minimum(np.arange(1500) // rows, 12) * np.linspace(0.1, 0.2, 1500)[0]
    uneven = np.cumsum(np.where(np.arange(1500) % rows == 0, 0.05 + np.arange(1500) / 1e4, 0.0))
    time = np.arange(1500) / RATE
    for x in (stairs, uneven):
        assert repeated_rows(a_test(x, solid(time, x))) == 0


def test_rows_written_several_times_are_no_slow_encoder():
    time, x, read = pressed()
    assert repeated_rows(a_test(repeated(read, 5), repeated(solid(time, x), 5))) == 0
