"""Control of a test or of parts of it: detected, stated by a file, and fitted as what it is."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.controlled import hold_and_recover, press_and_pause, record_controlled
from support.posteriors import from_truth
from support.solids import kinds, made_ready

from qlvbayes import InputError, Motion
from qlvbayes.io.data import Control, Prescribed, Test, read_measurements
from qlvbayes.motion.control import controls_of, force_phases, with_both_errors
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.trajectory import smooth
from qlvbayes.simulate import (
    NOISES,
    TABLE_1,
    Hold,
    Load,
    Move,
    creep_protocol,
    displacement_under,
    draw_constants,
    full_retraction_protocol,
    paper_protocol,
    prescribed,
    record_creep,
    simulate_test,
)
from qlvbayes.simulate.constants import Constants
from qlvbayes.simulate.sensors import Noise

B = TABLE_1["B"]
OTHER = draw_constants(np.random.default_rng([77, 0]))
CORRELATED = NOISES["correlated"]  # 0.006 N white and 0.008 N of a memory of 0.5 s: 0.01 N
FORCE, DISPLACEMENT = Control.FORCE, Control.DISPLACEMENT
FOUR = ["ramp", "hold", "unload", "recovery"]
PRESS, RECOVER = press_and_pause(1.0, 1.0, 10.0), hold_and_recover(1.6, 20.0, 10.0)
PER_SECOND = 50.0
LOOPS = pytest.mark.parametrize("closed_loop", [False, True])
WEIGHT = (Load(1.0, 0.0, 30.0),)
SHORT = Load(1.0, 0.1, 4.0), Load(0.3, 0.3, 4.0)


def as_read(found, **said):
    return Test("t", "B", found.time, found.displacement, found.force, **said)


def creep(program=None, noise=CORRELATED, seed=0, constants=B, rows=400, loop=False, **said):
    """A test whose force is prescribed throughout."""
    rng, program = np.random.default_rng(seed), program or creep_protocol(1.0)
    return as_read(record_creep(constants, program, noise, rng, 200.0, rows, loop), **said)


def recorded(program, seed=0, constants=B, noise=CORRELATED, closed_loop=False):
    """A test whose control changes, and (n,) where the force was prescribed."""
    rng = np.random.default_rng(seed)
    found, loaded = record_controlled(constants, program, noise, rng, PER_SECOND, closed_loop)
    return as_read(found), loaded


def stated(program, seed=0, constants=B, closed_loop=True):
    """A test whose file says when the force was prescribed: at its end."""
    test, loaded = recorded(program, seed, constants, closed_loop=closed_loop)
    begun, end = float(test.time[loaded][0]), float(test.time[-1])
    return replace(
        test, changes=(Prescribed(DISPLACEMENT, 0.0, begun), Prescribed(FORCE, begun, end))
    )


def pressed(program, seed=0, constants=B, rows=400):
    rng = np.random.default_rng(seed)
    return as_read(simulate_test(constants, program, CORRELATED, rng).thinned(rows))


def clocked(*tests):
    """Tests at rest before each, by their clock."""
    return made_ready(
        *(
            replace(test, name=f"t-{k}", start_s=500.0 * k, start_known=True)
            for k, test in enumerate(tests)
        ),
        all_tests=True,
    )


def force_of(model, time, displacement):
    still = jnp.zeros(len(time))
    return np.asarray(model.force(Motion(*map(jnp.asarray, (time, displacement)), still, still)))


def controls(test):
    return [part.control for part in controls_of(test, smooth(test.time, test.displacement))]


def phases_of(test):
    return made_ready(test, all_tests=True).trials[0].phases


def described(phases):
    return [(phase.kind, phase.control) for phase in phases]


PRESSED = [("ramp", DISPLACEMENT), ("hold", FORCE), ("unload", DISPLACEMENT)]


def test_the_model_gives_prescribed_and_simulated_forces_back(paper_model):
    back = partial(force_of, paper_model("B"))
    time, force = prescribed(SHORT)
    assert np.max(np.abs(back(time, displacement_under(B, time, force)) - force)) < 1e-5
    for program, begins in (
        (hold_and_recover(1.2, 2.0, 2.0), 2.6),
        (press_and_pause(1.0, 1.0, 2.0), None),
    ):
        found, loaded = record_controlled(B, program, NOISES["none"], np.random.default_rng(0), 1e3)
        force = back(found.time, found.true_displacement)
        np.testing.assert_allclose(np.maximum(force, 0.0), found.true_force, atol=1e-6)
        if begins:
            assert found.time[loaded][0] == pytest.approx(begins, abs=2e-3)


# what is prescribed is seen


@pytest.mark.slow
@pytest.mark.parametrize("program", [*map(creep_protocol, (0.3, 1.0, 2.0)), WEIGHT])
@LOOPS
def test_creep_is_seen_for_what_it_is(program, closed_loop):
    assert controls(creep(program, loop=closed_loop)) == [FORCE]


@pytest.mark.parametrize(
    ("program", "rows"),
    [
        (paper_protocol(0.1), 400),
        (paper_protocol(100.0), 400),
        (full_retraction_protocol(20.0), 400),
        (full_retraction_protocol(1.0), 2000),
        ((Move(1.6, 0.02),), 400),
        ((Move(0.8, 0.5), Hold(20.0), Move(1.6, 0.5), Hold(20.0)), 400),
        ((Move(1.6, 1.0), Hold(5.0), Move(-0.5, 1.0), Hold(5.0)), 2000),  # far out of contact
        # two speeds back, the slow one in air
        ((Move(1.6, 1.0), Move(0.4, 5.0), Move(-0.5, 0.2)), 2000),
        ((Move(1.6, 1.0), Hold(5.0, creep=0.1), Move(0.0, 1.0)), 2000),  # a frame that gives way
    ],
)
@pytest.mark.few(5)
def test_a_prescribed_displacement_is_never_taken_for_a_force(program, rows):
    assert controls(pressed(program, rows=rows)) == [DISPLACEMENT]


def test_a_drive_that_slows_down_for_long_and_rests_holds_no_force(paper_model):
    """The pad relaxes about as fast as the platen comes in, and goes on when that rests."""
    time = np.arange(0.0, 75.0, 0.05)
    depth = 0.95 * (1.0 - np.cos(np.pi * np.minimum(time, 60.0) / 60.0))
    still = jnp.zeros(time.size)
    force = np.asarray(
        paper_model("B").force(Motion(*map(jnp.asarray, (time, depth)), still, still))
    )
    read = force + CORRELATED.draw(time, np.random.default_rng(0))
    assert controls(Test("t", "B", time, np.round(depth, 3), read)) == [DISPLACEMENT]


@LOOPS
@pytest.mark.few(1)
def test_phases_have_the_control_that_they_had(closed_loop):
    test, loaded = recorded(PRESS, closed_loop=closed_loop)
    phases = phases_of(test)
    assert described(phases) == PRESSED
    (held,) = (phase for phase in phases if phase.control == FORCE)
    inside = (test.time >= held.start) & (test.time <= held.stop)
    # the ends are known as well as the force tells them from its noise
    assert np.mean(inside == loaded) > 0.98
    assert all(one.stop == two.start for one, two in pairwise(phases))
    assert (phases[0].start, phases[-1].stop) == (test.time[0], test.time[-1])


@pytest.mark.parametrize(("rested", "rate"), [(0.9, 0.3), (0.9, 3.0), (0.98, 0.3), (0.7, 3.0)])
@pytest.mark.parametrize("speed", [0.5, 5.0])
@pytest.mark.parametrize("pause", [2.0, 20.0])
@pytest.mark.few(2)
def test_a_pause_under_a_force_is_a_hold_however_little_it_creeps(rested, rate, speed, pause):
    """By 0.1 to 14 % of the displacement; the ramp ends where the force does."""
    constants, white = Constants(0.5, 0.8, (rested, 1.0 - rested), (rate,)), 5e-4
    program = press_and_pause(1.0, speed, pause)
    found, loaded = recorded(program, constants=constants, noise=Noise(white, 0.0))
    experiment = made_ready(found)
    phases = experiment.trials[0].phases
    assert kinds(phases)[:3] == ["ramp", "hold", "unload"]
    ends = found.time[np.flatnonzero(loaded)[[0, -1]]]
    assert (phases[1].start, phases[1].stop) == pytest.approx(ends, abs=0.05 * pause)
    assert 0.5 * white < experiment.floor.total < 2.0 * white


@LOOPS
@pytest.mark.few(1)
def test_phases_of_creep_are_those_of_the_force(closed_loop):
    test = creep(loop=closed_loop)
    found = force_phases(test, test.time)
    assert kinds(found) == FOUR
    # found to a twentieth of the way or to a reading, whichever is more
    for phase, end, slack in zip(found, (0.1, 30.1, 30.4), (0.02, 0.1, 0.1), strict=False):
        assert phase.stop == pytest.approx(end, abs=slack)
    weight = creep(WEIGHT)
    assert kinds(force_phases(weight, weight.time)) == ["hold"]


# motion, noise and record under a force


def test_the_motion_does_not_swing_between_sparse_readings_and_follows_the_creep():
    test = creep(constants=OTHER, control="force")
    time, force = prescribed(creep_protocol(1.0), 200.0)
    truth = displacement_under(OTHER, time, force)
    inside = time <= test.time[-1]
    path = clocked(test).trials[0].trajectory
    error = np.abs(path.displacement(time[inside]) - truth[inside])
    # a line between readings is off creep by what it bends: 1 % of the way between, and a step
    way = np.abs(np.diff(np.interp(test.time, time, truth))).max()
    assert error.max() < 0.02 * way + 2e-3
    test, loaded = recorded(PRESS)
    truth, _ = record_controlled(B, PRESS, CORRELATED, np.random.default_rng(0), PER_SECOND)
    error = np.abs(
        clocked(test).trials[0].trajectory.displacement(test.time) - truth.true_displacement
    )
    assert np.ptp(test.displacement[loaded]) > 0.05
    assert error.max() < 2e-3  # two steps of the encoder


@pytest.mark.parametrize(
    ("tests", "most"),
    [
        (lambda: (creep(), creep(creep_protocol(0.5), seed=1)), 1.6),
        (lambda: (creep(loop=True), creep(creep_protocol(0.5), seed=1)), 1.6),
        (lambda: recorded(PRESS, closed_loop=True)[:1], 1.6),
        # at no force the controller cannot pull: taken rather for too large than for too small
        (lambda: [stated(RECOVER)], 2.0),
    ],
    ids=["weights", "closed loop", "pause", "recovery"],
)
@pytest.mark.few(3)
def test_the_noise_shows_whatever_the_controller_follows(tests, most):
    """A controller's slow errors are in no reading of a held force, and yet in the model's."""
    tests = tests()
    found = clocked(*tests).floor
    assert 0.6 * 0.01 < found.total < most * 0.01
    if len(tests) == 2:
        assert found.total > 0.8 * 0.01
        assert found.ou > 0.5 * 0.008


def test_of_an_exact_force_the_displacement_tells_the_noise():
    """A sensor of 5 um with a weight: stiffness times that."""
    test = creep(noise=NOISES["none"], rows=800)
    shaken = 5e-3 * np.random.default_rng(0).standard_normal(test.time.size)
    floor = clocked(replace(test, displacement=test.displacement + shaken)).floor.total
    steepest, least = (B.m * np.exp(B.b * d) for d in (2.2, 1.3))
    assert 5e-3 * least * B.c[0] < floor < 5e-3 * steepest


def test_a_record_begins_with_the_jump(paper_model):
    found = clocked(creep(WEIGHT))
    motion = jax.tree.map(lambda x: x[0], found.record(found.trials).motion)
    assert float(motion.displacement[0]) > 1.0
    assert np.max(np.abs(np.asarray(paper_model("B").force(motion)) - 1.0)) < 0.01


# what a file says


def written(path, test, control):
    rows = zip(test.time, test.displacement, test.force, control, strict=True)
    lines = [f"{t:.4f},{d:.3f},{f:.5f},{c}" for t, d, f, c in rows]
    path.write_text("\n".join(["time_s,displacement_mm,force_N,control", *lines]) + "\n")
    return path


def test_a_column_says_it_row_by_row_and_a_cut_keeps_it(tmp_path):
    test, loaded = recorded(PRESS)
    file = written(tmp_path / "a.csv", test, np.where(loaded, "force", "displacement"))
    pad = read_measurements(file).pads[0]
    (read,) = pad.tests
    ends = test.time[np.flatnonzero(loaded)[[0, -1]]] + 0.5 / PER_SECOND * np.array([-1.0, 1.0])
    assert read.control is None
    assert [part.control for part in read.changes] == [DISPLACEMENT, FORCE, DISPLACEMENT]
    assert (read.changes[1].start, read.changes[1].stop) == pytest.approx(ends, abs=1e-6)
    found = prepare(pad)
    assert described(found.trials[0].phases) == PRESSED
    assert found.notices == ()  # it is no guess
    (trial,) = prepare(pad, use=["test:0..8s"]).trials
    assert described(trial.phases) == PRESSED[:2]
    (trial,) = prepare(pad, use=["test:3..20s"]).trials
    assert described(trial.phases) == PRESSED[1:]
    assert trial.phases[0].stop == pytest.approx(test.time[loaded][-1] - 3.0, abs=0.01)


@pytest.mark.parametrize(
    ("words", "message"),
    [(("force", ""), "line 2: control is empty"), (("weight", "force"), "'weight' is unknown")],
)
def test_a_column_that_says_it_for_some_rows_only_or_in_other_words_is_refused(
    tmp_path, words, message
):
    test, loaded = recorded(PRESS)
    with pytest.raises(InputError, match=message):
        read_measurements(written(tmp_path / "a.csv", test, np.where(loaded, *words)))


def test_what_the_file_says_counts():
    """And only where the force is prescribed, the displacement adds noise."""
    test = stated(RECOVER)
    phases = phases_of(test)
    recovered = [("ramp", DISPLACEMENT), ("hold", DISPLACEMENT), ("recovery", FORCE)]
    assert described(phases) == recovered
    (read,) = with_both_errors([test], [phases])
    before = test.time < phases[-1].start
    assert np.array_equal(read.force[before], test.force[before])
    assert not np.allclose(read.force[~before], test.force[~before])
    test, _ = recorded(PRESS)
    assert {p.control for p in phases_of(replace(test, control=DISPLACEMENT))} == {DISPLACEMENT}
    said = Prescribed(FORCE, 0.0, 5.0), Prescribed(DISPLACEMENT, 5.0, float(test.time[-1]))
    phases = phases_of(replace(test, changes=said))
    assert {p.control for p in phases if p.stop <= 5.0} == {FORCE}
    assert {p.control for p in phases if p.start >= 5.0} == {DISPLACEMENT}


# constants


def creeps(constants, seed, loop=False):
    peak = float(constants.force(np.array([1.2]))[0])
    return [
        creep(creep_protocol(share * peak), seed=[seed, k], constants=constants, loop=loop,
              control="force")
        for k, share in enumerate((0.3, 0.6))
    ]  # fmt: skip


def pauses(constants, seed, loop=False):
    """Two presses to a force, and one recovery at no force."""
    peak = float(constants.force(np.array([1.2]))[0])
    programs = press_and_pause(peak, 1.0, 10.0), press_and_pause(0.5 * peak, 5.0, 10.0)
    return [
        *(
            recorded(program, [seed, k], constants, closed_loop=loop)[0]
            for k, program in enumerate(programs)
        ),
        stated(RECOVER, [seed, 2], constants, closed_loop=loop),
    ]


def with_a_relaxation(constants, seed):
    return [*creeps(constants, seed), pressed(paper_protocol(20.0), seed, constants)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tests", "more", "count"),
    [(creeps, {"loop": True}, 10), (with_a_relaxation, {}, 10), (pauses, {"loop": True}, 6)],
)
def test_intervals_hold_the_truth(tests, more, count):
    inside = []
    for seed in range(count):
        constants = draw_constants(np.random.default_rng([77, seed]))
        found = from_truth(constants, clocked(*tests(constants, seed, **more)))
        inside.append([abs(z) < 1.645 for z in found.values()])
    # 90 % of pads by 7 constants that hang together: at least as many as these pads hold by chance
    assert np.mean(inside) > 0.9 - 3.0 * np.sqrt(0.09 / count)
