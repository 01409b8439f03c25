"""Control that changes within a test: detected, stated by a column, and fitted as what it is."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.controlled import hold_and_recover, press_and_pause, record_controlled
from support.posteriors import from_truth

from qlvbayes import InputError
from qlvbayes.io.data import Control, Pad, Prescribed, Test, read_measurements
from qlvbayes.io.units import PAD
from qlvbayes.motion.control import controls_of, with_both_errors
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.trajectory import smooth
from qlvbayes.simulate import (
    NOISES,
    TABLE_1,
    Hold,
    Move,
    draw_constants,
    full_retraction_protocol,
    simulate_test,
)
from qlvbayes.simulate.constants import Constants
from qlvbayes.simulate.sensors import Noise

B = TABLE_1["B"]
CORRELATED = NOISES["correlated"]  # 0.006 N white and 0.008 N of a memory of 0.5 s: 0.01 N
PRESS, RECOVER = press_and_pause(1.0, 1.0, 10.0), hold_and_recover(1.6, 20.0, 10.0)
PER_SECOND = 50.0
FORCE, DISPLACEMENT = Control.FORCE, Control.DISPLACEMENT


def recorded(program, seed=0, constants=B, noise=CORRELATED, closed_loop=False):
    """A test whose control changes, and (n,) where the force was prescribed."""
    rng = np.random.default_rng(seed)
    found, loaded = record_controlled(constants, program, noise, rng, PER_SECOND, closed_loop)
    return Test("t", "B", found.time, found.displacement, found.force), loaded


def prepared(*tests):
    return prepare(Pad("B", tests, PAD), all_tests=True)


def clocked(*tests):
    """Tests at rest before each, by their clock."""
    return prepared(
        *(
            replace(test, name=f"t-{k}", start_s=500.0 * k, start_known=True)
            for k, test in enumerate(tests)
        )
    )


def phases_of(test):
    (trial,) = prepared(test).trials
    return trial.phases


def described(phases):
    return [(phase.kind, phase.control) for phase in phases]


PRESSED = [("ramp", DISPLACEMENT), ("hold", FORCE), ("unload", DISPLACEMENT)]
RECOVERED = [
    ("ramp", DISPLACEMENT), ("hold", DISPLACEMENT), ("unload", DISPLACEMENT), ("recovery", FORCE),
]  # fmt: skip


def test_the_simulator_agrees_with_a_stiff_solver():
    """The elastic force and its modes under each control in turn, by another integrator."""
    found, loaded = record_controlled(
        B, hold_and_recover(1.2, 2.0, 4.0), NOISES["none"], np.random.default_rng(0), 1000.0
    )
    c, v = np.array(B.c[1:]), np.array(B.v)

    def pressed(t, state, speed):
        flow = (B.m + B.b * state[0]) * speed
        return [flow, *(flow - v * state[1:])]

    def unloaded(t, state, rate):
        flow = rate + np.sum(c * v * state[1:])
        return [flow, *(flow - v * state[1:])]

    state, corner = np.zeros(3), 0.0
    force = 0.0
    for slopes, value, lasts in ((pressed, 2.0, 0.6), (pressed, 0.0, 4.0), (unloaded, None, 0.2),
                                 (unloaded, 0.0, 4.0)):  # fmt: skip
        rate = -force / lasts if value is None else value
        solved = solve_ivp(
            slopes, (0.0, lasts), state, "Radau", args=(rate,), rtol=1e-10, atol=1e-12
        )
        state, corner = solved.y[:, -1], corner + lasts
        force = float(np.dot(B.c, state))
        at = int(np.argmin(np.abs(found.time - corner)))
        assert found.true_displacement[at] == pytest.approx(
            np.log1p(B.b * state[0] / B.m) / B.b, rel=1e-7
        )
        assert found.true_force[at] == pytest.approx(max(force, 0.0), abs=1e-7)
    assert found.time[np.flatnonzero(loaded)[0]] == pytest.approx(4.6, abs=2e-3)


@pytest.mark.parametrize("closed_loop", [False, True])
@pytest.mark.parametrize(("program", "kinds"), [(PRESS, PRESSED), (RECOVER, RECOVERED)])
def test_phases_have_the_control_that_they_had(program, kinds, closed_loop):
    test, loaded = recorded(program, closed_loop=closed_loop)
    phases = phases_of(test)
    assert described(phases) == kinds
    (held,) = (phase for phase in phases if phase.control == FORCE)
    inside = (test.time >= held.start) & (test.time <= held.stop)
    # the ends are known as well as the force tells them from its noise
    assert np.mean(inside == loaded) > 0.98
    assert all(one.stop == two.start for one, two in pairwise(phases))
    assert (phases[0].start, phases[-1].stop) == (test.time[0], test.time[-1])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.few(2)
def test_other_pads_are_read_alike(seed):
    constants = draw_constants(np.random.default_rng([77, seed]))
    peak = float(constants.force(np.array([1.2]))[0])
    pressed, _ = recorded(press_and_pause(peak, 1.0, 10.0), seed, constants)
    recovered, _ = recorded(RECOVER, seed, constants)
    assert described(phases_of(pressed)) == PRESSED
    assert described(phases_of(recovered)) == RECOVERED


@pytest.mark.parametrize(
    "program",
    [
        full_retraction_protocol(1.0),
        (Move(1.6, 1.0), Hold(5.0), Move(-0.5, 1.0), Hold(5.0)),  # far out of contact
        (Move(1.6, 1.0), Move(0.4, 5.0), Move(-0.5, 0.2)),  # two speeds back, the slow one in air
        (Move(1.6, 1.0), Hold(5.0, creep=0.1), Move(0.0, 1.0)),
    ],
)
def test_a_platen_that_moves_in_air_is_no_recovery(program):
    found = simulate_test(B, program, CORRELATED, np.random.default_rng(0)).thinned(2000)
    test = Test("t", "B", found.time, found.displacement, found.force)
    controls = controls_of(test, smooth(test.time, test.displacement))
    assert [part.control for part in controls] == [DISPLACEMENT]


def test_a_drive_that_slows_down_for_long_and_rests_holds_no_force():
    """The pad relaxes about as fast as the platen comes in, and goes on when that rests."""
    time = np.arange(0.0, 75.0, 0.05)
    depth = 0.95 * (1.0 - np.cos(np.pi * np.minimum(time, 60.0) / 60.0))
    elastic, force = B.force(depth), B.c[0] * B.force(depth)
    for c, v in zip(B.c[1:], B.v, strict=True):
        mode, fading = np.zeros(time.size), np.exp(-v * 0.05)
        for k in range(1, time.size):
            mode[k] = fading * (mode[k - 1] + elastic[k] - elastic[k - 1])
        force = force + c * mode
    read = force + CORRELATED.draw(time, np.random.default_rng(0))
    test = Test("t", "B", time, np.round(depth, 3), read)
    controls = controls_of(test, smooth(test.time, test.displacement))
    assert [part.control for part in controls] == [DISPLACEMENT]


def test_motion_follows_the_creep():
    test, loaded = recorded(PRESS)
    truth, _ = record_controlled(B, PRESS, CORRELATED, np.random.default_rng(0), PER_SECOND)
    (trial,) = prepared(test).trials
    error = np.abs(trial.trajectory.displacement(test.time) - truth.true_displacement)
    assert np.ptp(test.displacement[loaded]) > 0.05
    assert error.max() < 2e-3  # two steps of the encoder


@pytest.mark.parametrize(("program", "most"), [(PRESS, 1.6), (RECOVER, 2.0)])
def test_noise_of_a_controller_shows_in_the_displacement(program, most):
    """Its slow errors are in no reading of a held force, and yet in the model's force.

    At no force the controller cannot pull: what it then does is less like noise, which is taken
    rather for too large than for too small.
    """
    floor = prepared(recorded(program, closed_loop=True)[0]).floor
    assert 0.6 * 0.01 < floor.total < most * 0.01


def test_only_where_the_force_is_prescribed_the_displacement_adds_noise():
    test, _ = recorded(RECOVER, closed_loop=True)
    (trial,) = prepared(test).trials
    (read,) = with_both_errors([test], [trial.phases])
    start = trial.phases[-1].start
    before, after = test.time < start, test.time > start
    assert np.array_equal(read.force[before], test.force[before])
    assert not np.allclose(read.force[after], test.force[after])


def written(path, test, control):
    rows = zip(test.time, test.displacement, test.force, control, strict=True)
    lines = [f"{t:.4f},{d:.3f},{f:.5f},{c}" for t, d, f, c in rows]
    path.write_text("\n".join(["time_s,displacement_mm,force_N,control", *lines]) + "\n")
    return path


def test_a_column_says_it_row_by_row(tmp_path):
    test, loaded = recorded(PRESS)
    file = written(tmp_path / "a.csv", test, np.where(loaded, "force", "displacement"))
    (read,) = read_measurements(file).pads[0].tests
    first, last = test.time[np.flatnonzero(loaded)[[0, -1]]]
    half = 0.5 / PER_SECOND
    assert read.control is None
    assert [part.control for part in read.changes] == [DISPLACEMENT, FORCE, DISPLACEMENT]
    assert read.changes[1].start == pytest.approx(first - half, abs=1e-6)
    assert read.changes[1].stop == pytest.approx(last + half, abs=1e-6)
    found = prepare(read_measurements(file).pads[0])
    assert described(found.trials[0].phases) == PRESSED
    assert found.notices == ()  # it is no guess


def test_a_column_that_says_it_for_some_rows_only_is_refused(tmp_path):
    test, loaded = recorded(PRESS)
    file = written(tmp_path / "a.csv", test, np.where(loaded, "force", ""))
    with pytest.raises(InputError, match=r"line 2: control is empty"):
        read_measurements(file)
    file = written(tmp_path / "a.csv", test, np.where(loaded, "weight", "force"))
    with pytest.raises(InputError, match="control 'weight' is unknown"):
        read_measurements(file)


def test_what_the_file_says_counts():
    test, _ = recorded(PRESS)
    assert {p.control for p in phases_of(replace(test, control=DISPLACEMENT))} == {DISPLACEMENT}
    ends = (0.0, 5.0, float(test.time[-1]))
    said = tuple(map(Prescribed, (FORCE, DISPLACEMENT), ends[:-1], ends[1:]))
    phases = phases_of(replace(test, changes=said))
    assert {p.control for p in phases if p.stop <= 5.0} == {FORCE}
    assert {p.control for p in phases if p.start >= 5.0} == {DISPLACEMENT}


def test_a_cut_keeps_what_was_stated(tmp_path):
    test, loaded = recorded(PRESS)
    file = written(tmp_path / "a.csv", test, np.where(loaded, "force", "displacement"))
    pad = read_measurements(file).pads[0]
    (trial,) = prepare(pad, use=["test:0..8s"]).trials
    assert described(trial.phases) == PRESSED[:2]
    (trial,) = prepare(pad, use=["test:3..20s"]).trials
    assert described(trial.phases) == PRESSED[1:]
    (held, _) = trial.phases
    assert held.stop == pytest.approx(test.time[loaded][-1] - 3.0, abs=0.01)


def pressed_and_recovered(seed, constants, closed_loop):
    """Two presses to a force, and one recovery at no force."""
    peak = float(constants.force(np.array([1.2]))[0])
    programs = press_and_pause(peak, 1.0, 10.0), press_and_pause(0.5 * peak, 5.0, 10.0), RECOVER
    return [
        recorded(program, [seed, k], constants, closed_loop=closed_loop)[0]
        for k, program in enumerate(programs)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("closed_loop", [False, True])
def test_intervals_hold_the_truth(closed_loop):
    count = 6
    inside = []
    for seed in range(count):
        constants = draw_constants(np.random.default_rng([77, seed]))
        tests = pressed_and_recovered(seed, constants, closed_loop)
        inside.append([abs(z) < 1.645 for z in from_truth(constants, clocked(*tests)).values()])
    # 90 % of pads by 7 constants that hang together: at least as many as these pads hold by chance
    assert np.mean(inside) > 0.9 - 3.0 * np.sqrt(0.09 / count)


def test_the_kept_pause_under_a_force():
    file = Path(__file__).parents[3] / "shared" / "records" / "press_pause_back_tidy.csv"
    if not file.exists():
        pytest.skip(f"{file.name} is not kept here")
    (trial,) = prepare(read_measurements(file).pads[0]).trials
    assert described(trial.phases) == PRESSED
    held = trial.phases[1]
    assert (held.start, held.stop) == pytest.approx((1.8, 3.8), abs=0.04)


@pytest.mark.parametrize(("rested", "rate"), [(0.9, 0.3), (0.9, 3.0), (0.98, 0.3), (0.7, 3.0)])
@pytest.mark.parametrize("speed", [0.5, 5.0])
@pytest.mark.parametrize("pause", [2.0, 20.0])
@pytest.mark.few(5)
def test_a_pause_under_a_force_is_a_hold_however_little_it_creeps(rested, rate, speed, pause):
    """By 0.1 to 14 % of the displacement; the ramp ends where the force does."""
    constants, white = Constants(0.5, 0.8, (rested, 1.0 - rested), (rate,)), 5e-4
    program = press_and_pause(1.0, speed, pause)
    found, loaded = recorded(program, constants=constants, noise=Noise(white, 0.0))
    experiment = prepared(found)
    phases = experiment.trials[0].phases
    assert [phase.kind for phase in phases][:3] == ["ramp", "hold", "unload"]
    begun, ended = found.time[np.flatnonzero(loaded)[[0, -1]]]
    assert phases[1].start == pytest.approx(begun, abs=0.05 * pause)
    assert phases[1].stop == pytest.approx(ended, abs=0.05 * pause)
    assert 0.5 * white < experiment.floor.total < 2.0 * white
