"""Phases of a motion: the ones that an experimenter would name, from end to end of the record."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import motions
from support.solids import kinds, made_ready

from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Test
from qlvbayes.motion.phases import find_phases, loading_rate
from qlvbayes.motion.trajectory import smooth

REAL = Path(__file__).parents[3] / "shared" / "real"
STEP = 1e-3


def record(corners, dt=1e-3, step=STEP):
    """Straight lines through (time, depth) corners, read in encoder steps."""
    times, depths = np.array(corners, dtype=float).T
    t = np.arange(times[0], times[-1] + 0.5 * dt, dt)
    return t, motions.rounded(np.interp(t, times, depths), step)


def moving(phases):
    return [kind for kind in kinds(phases) if kind in ("ramp", "unload")]


def cover(phases, t):
    assert phases[0].start == pytest.approx(t[0])
    assert phases[-1].stop == pytest.approx(t[-1])
    assert all(a.stop == b.start for a, b in pairwise(phases))
    assert all(p.stop > p.start for p in phases)


def test_the_four_phases_of_a_test():
    t, x = record([(0, 0), (0.5, 0), (0.58, 1.6), (10, 1.6), (11.6, 0), (20, 0)])
    phases = find_phases(smooth(t, x))
    cover(phases, t)
    assert kinds(phases) == ["hold", "ramp", "hold", "unload", "recovery"]
    edges = [p.start for p in phases[1:]]
    assert np.allclose(edges, [0.5, 0.58, 10.0, 11.6], atol=3e-3)


@pytest.mark.parametrize("speed", [0.1, 7.3])
@pytest.mark.few(1)
def test_a_staircase_up_and_down(speed):
    at = np.append(0.0, np.cumsum([0.2 / speed, 3.0] * 10))
    depths = np.repeat(np.cumsum([0.0] + [0.2] * 5 + [-0.2] * 5), 2)[1:]
    t, x = record(list(zip(at, depths, strict=True)))
    phases = find_phases(smooth(t, x))
    cover(phases, t)
    assert kinds(phases) == ["ramp", "hold"] * 5 + ["unload", "recovery"] * 5


def relaxed(t, since, size, tau):
    """A platen gives way by a size from a moment on, ever more slowly."""
    return size * (1.0 - np.exp(-np.maximum(t - since, 0.0) / tau))


def rounded(t, x, step=1e-4):
    return smooth(t, motions.rounded(x, step))


@pytest.mark.parametrize(
    ("size", "tau", "until"),
    [(0.02, 1.0, 40.0), (0.025, 5.0, 40.0), (0.04, 5.0, 40.0), (0.06, 2.0, 40.0), (0.06, 5.0, 8.0)],
)
@pytest.mark.few(3)
def test_a_platen_that_creeps_back_is_held(size, tau, until):
    t = np.arange(0.0, until, 0.02)
    x = np.interp(t, [0.5, 1.5], [0.0, 2.0]) - relaxed(t, 1.5, size, tau)
    motion = rounded(t, x)
    phases = find_phases(motion)
    cover(phases, t)
    assert kinds(phases) == ["hold", "ramp", "hold"]
    assert phases[2].start == pytest.approx(1.5, abs=0.02)
    assert motion.displacement(t[-1]) == pytest.approx(x[-1], abs=3e-4)


def test_a_platen_that_creeps_in_after_it_came_back_recovers():
    t = np.arange(0.0, 60.0, 0.02)
    x = np.interp(t, [0.5, 1.5, 20.0, 21.0], [0.0, 2.0, 2.0, 0.2]) + relaxed(t, 21.0, 0.04, 5.0)
    assert kinds(find_phases(rounded(t, x))) == ["hold", "ramp", "hold", "unload", "recovery"]


@pytest.mark.parametrize(("way", "step"), [(0.5, ["ramp", "hold"]), (-0.5, ["unload", "recovery"])])
@pytest.mark.few(1)
def test_steps_after_each_of_which_the_platen_creeps_back(way, step):
    t = np.arange(0.0, 60.0, 0.02)
    x = sum(
        way * np.clip(t - at, 0.0, 1.0) - relaxed(t, at + 1, 0.04 * way, 4.0) for at in (1.0, 31.0)
    )
    assert kinds(find_phases(rounded(t, x))) == ["hold", *step * 2]


@pytest.mark.parametrize("size", [0.03, 0.06, 0.2])
@pytest.mark.parametrize("lasting", [10.0, 38.0])
@pytest.mark.few(2)
def test_a_slow_way_back_that_is_meant_is_no_creep(size, lasting):
    """At a steady speed, or by half a cosine: both lie as much in their last half as before."""
    t = np.arange(0.0, 22.0 + lasting, 0.02)
    for course in (lambda u: u, lambda u: 0.5 - 0.5 * np.cos(np.pi * u)):
        back = size * course(np.clip((t - 1.5) / lasting, 0.0, 1.0))
        phases = find_phases(rounded(t, np.interp(t, [0.5, 1.5], [0.0, 2.0]) - back))
        assert kinds(phases)[:3] == ["hold", "ramp", "unload"], (size, lasting)


def test_small_cycles_whose_ways_slow_down_are_no_creep():
    t = np.arange(0.0, 120.0, 0.02)
    x, size = np.interp(t, [0.5, 1.5], [0.0, 2.0]), -0.06
    for at in np.arange(1.5, 120.0, 20.0):
        x, size = x + relaxed(t, at, size, 3.0), -size
    assert moving(find_phases(rounded(t, x))) == ["ramp", "unload"] * 3 + ["ramp"]


def test_a_record_at_rest_is_one_hold():
    t = np.arange(0.0, 5.0, 1e-3)
    motion = smooth(t, np.full(t.size, 0.2))
    phases = find_phases(motion)
    assert kinds(phases) == ["hold"]
    with pytest.raises(InputError, match="no loading ramp"):
        loading_rate(motion, phases)


@settings(max_examples=8, deadline=None)
@given(st.floats(0.2, 50.0), st.floats(0.5, 3.0))
def test_loading_rate_is_the_speed_of_the_ramp(speed, stroke):
    lasts = stroke / speed
    corners = [(0, 0), (0.2, 0), (0.2 + lasts, stroke), (2 + lasts, stroke)]
    t, x = record(corners, dt=np.clip(0.01 * lasts, 1e-3, 1e-2))
    motion = smooth(t, x)
    assert loading_rate(motion, find_phases(motion)) == pytest.approx(speed, rel=0.02)


def real(name, depth, every):
    path = REAL / name
    if not path.exists():
        pytest.skip(f"{name} is not here")
    tests = list(pd.read_csv(path).groupby(["pad", "test"], sort=False))
    for (pad, test), rows in tests[::every]:
        t, x = rows["time_s"].to_numpy(float), rows[depth].to_numpy(float)
        motion = smooth(t, x)
        phases = find_phases(motion)
        cover(phases, t)
        yield str(pad), str(test), motion, phases


def test_measured_muscle_is_ramp_and_hold_at_its_stated_duration():
    for _, test, motion, phases in real("muscle_ramps.csv", "strain", 6):
        assert kinds(phases) == ["ramp", "hold"], test
        duration = float(test.rsplit("-", 1)[1].removesuffix("s"))
        assert phases[0].stop == pytest.approx(duration, rel=0.01)
        assert loading_rate(motion, phases) == pytest.approx(0.2258 / duration, rel=0.01)


@settings(max_examples=6, deadline=None)
@given(
    start=st.floats(0.4, 0.5),
    depth=st.floats(3.0, 7.0),
    brake=st.floats(0.01, 0.15),
    over=st.sampled_from([0.0, 2e-5, 5e-5]),
)
def test_a_ramp_ends_anywhere_between_two_readings(start, depth, brake, over):
    """A testing machine's file: 10 readings a second, a controlled stop, a trace of overshoot."""
    time = np.round(np.arange(0.0, 17.9, 0.1), 10)
    moving = np.clip(time - start, 0.0, None)  # at 1 mm/s
    left = np.clip(depth + 0.5 * brake - moving, 0.0, brake)
    way = np.where(left < brake, depth - left**2 / (2.0 * brake), moving)
    way += over * np.where(moving > depth, np.exp((depth - moving) / 0.3), 0.0)
    motion = smooth(time, way, 0.0)
    assert motion.top_speed < 3.0
    assert kinds(find_phases(motion))[-2:] == ["ramp", "hold"]


TIME = np.arange(0.0, 30.0, 0.02)
DOWN = np.interp(TIME, [0.5, 1.5], [60.0, 58.0])


JITTER = 2e-3 * (np.random.default_rng(1).random(TIME.size) > 0.5)


@pytest.mark.parametrize(
    ("displacement", "force", "says"),
    [
        (DOWN, 60.0 - DOWN,
         ("its displacement only falls, from 60 to 58 mm, while the force rises",
          "its value at first contact minus each value")),
        (DOWN - 58.0, DOWN - 58.0,
         ("only falls, from 2 to 0 mm, and the force falls with it",
          "add the rows of the loading before it",
          "multiply displacement and force by -1 if this is the loading")),
        (2.0 + JITTER, np.exp(-TIME / 5.0),
         ("its displacement changes by 0.002 mm only",
          "add the rows of the ramp before this hold, or delete the test")),
    ],
    ids=["turned over", "unloading alone", "hold alone"],
)  # fmt: skip
def test_a_test_without_a_ramp_is_refused_with_its_remedy(displacement, force, says):
    noise = 1e-3 * np.random.default_rng(0).standard_normal(TIME.size)
    with pytest.raises(InputError) as caught:
        made_ready(Test("slow", "p", TIME, displacement, force + noise))
    text = str(caught.value)
    assert text.startswith("test slow of pad p holds no loading ramp: ")
    assert "\n" not in text
    assert all(words in text for words in says)
