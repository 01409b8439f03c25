"""Load control, of tests and of parts of them: detected, cut by the force, with both noises."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.posteriors import from_truth

from qlvbayes import InputError, Model, Motion
from qlvbayes.io.data import Pad, Test, read_measurements
from qlvbayes.io.units import PAD
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.motion.control import controls_of, force_phases
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.trajectory import smooth
from qlvbayes.simulate import (
    NOISES,
    TABLE_1,
    Hold,
    Load,
    Move,
    creep_protocol,
    creep_study,
    displacement_under,
    draw_constants,
    full_retraction_protocol,
    paper_protocol,
    prescribed,
    record_creep,
    simulate_test,
    write_csv,
)

B = TABLE_1["B"]
CORRELATED = NOISES["correlated"]  # 0.006 N white and 0.008 N of a memory of 0.5 s: 0.01 N
ROWS = 400
BASELINE = creep_protocol(1.0)


def creep(
    program=BASELINE, noise=CORRELATED, seed=0, constants=B, rows=ROWS, closed_loop=False, **said
):
    rng = np.random.default_rng(seed)
    found = record_creep(constants, program, noise, rng, max_rows=rows, closed_loop=closed_loop)
    return Test("creep", "B", found.time, found.displacement, found.force, **said)


def pressed(program, seed=0, constants=B):
    found = simulate_test(constants, program, CORRELATED, np.random.default_rng(seed)).thinned(ROWS)
    return Test("pressed", "B", found.time, found.displacement, found.force)


def prepared(*tests):
    named = [
        replace(test, name=f"{test.name}-{k}", start_s=500.0 * k, start_known=True)
        for k, test in enumerate(tests)
    ]
    return prepare(Pad("B", tuple(named), PAD), all_tests=True)


def control_of(test):
    """The control of the whole test, or of its parts where that changes."""
    controls = controls_of(test, smooth(test.time, test.displacement))
    return controls[0].control if len(controls) == 1 else [part.control for part in controls]


def motion_of(time, displacement):
    still = jnp.zeros(len(time))
    return Motion(jnp.asarray(time), jnp.asarray(displacement), still, still)


def test_the_simulated_creep_is_that_of_a_stiff_solver():
    c, v = np.array(B.c[1:]), np.array(B.v)

    def slopes(t, state, rate):
        stiffness = B.m * np.exp(B.b * state[0])
        speed = (rate + np.sum(c * v * state[1:])) / stiffness
        return [speed, *(stiffness * speed - v * state[1:])]

    state, ends = np.zeros(3), []
    corners = np.array([0.0, 0.1, 30.1, 30.4, 60.4])
    for k, rate in enumerate((10.0, 0.0, -0.7 / 0.3, 0.0)):
        span = tuple(corners[k : k + 2])
        found = solve_ivp(slopes, span, state, "Radau", args=(rate,), rtol=1e-10, atol=1e-12)
        state = found.y[:, -1]
        ends.append(state[0])
    time, force = prescribed(creep_protocol(1.0))
    crept = np.interp(corners[1:], time, displacement_under(B, time, force))
    assert np.allclose(crept, ends, rtol=1e-8)


def test_the_model_gives_the_prescribed_force_back(paper_model):
    time, force = prescribed(creep_protocol(1.0))
    back = paper_model("B").force(motion_of(time, displacement_under(B, time, force)))
    assert np.max(np.abs(np.asarray(back) - force)) < 1e-5


@pytest.mark.slow
def test_creep_is_seen_for_what_it_is():
    for load in (0.3, 1.0, 2.0):
        assert control_of(creep(creep_protocol(load))) == "force"
        assert control_of(creep(creep_protocol(load), closed_loop=True)) == "force"
    assert control_of(creep([Load(1.0, 0.0, 30.0)])) == "force"


@pytest.mark.parametrize(
    "program",
    [
        paper_protocol(0.1),
        paper_protocol(100.0),
        full_retraction_protocol(20.0),
        (Move(1.6, 1.0), Hold(30.0, creep=0.1)),  # a frame that gives way
        (Move(1.6, 0.02),),
        (Move(0.8, 0.5), Hold(20.0), Move(1.6, 0.5), Hold(20.0)),
    ],
)
def test_a_prescribed_displacement_is_never_taken_for_a_force(program):
    assert control_of(pressed(program)) == "displacement"


def force_phases_of(test):
    return force_phases(test, test.time)


@pytest.mark.parametrize("closed_loop", [False, True])
def test_phases_are_those_of_the_force(closed_loop):
    found = force_phases_of(creep(closed_loop=closed_loop))
    assert [phase.kind for phase in found] == ["ramp", "hold", "unload", "recovery"]
    # found to a twentieth of the way or to a reading, whichever is more
    for phase, end, slack in zip(found, (0.1, 30.1, 30.4), (0.02, 0.1, 0.1), strict=False):
        assert phase.stop == pytest.approx(end, abs=slack)


def test_a_weight_from_the_first_reading_is_a_hold():
    assert [phase.kind for phase in force_phases_of(creep([Load(1.0, 0.0, 30.0)]))] == ["hold"]


def test_the_motion_does_not_swing_between_sparse_readings():
    test = creep(constants=draw_constants(np.random.default_rng([77, 0])))
    time, force = prescribed(creep_protocol(1.0))
    truth = displacement_under(draw_constants(np.random.default_rng([77, 0])), time, force)
    inside = time <= test.time[-1]
    path = prepared(replace(test, control="force")).trials[0].trajectory
    error = np.abs(path.displacement(time[inside]) - truth[inside])
    # a line between readings is off creep by what it bends: 1 % of the way between, and a step
    way = np.abs(np.diff(np.interp(test.time, time, truth))).max()
    assert error.max() < 0.02 * way + 2e-3


@pytest.mark.parametrize("closed_loop", [False, True])
def test_the_noise_shows_whatever_the_controller_follows(closed_loop):
    found = prepared(creep(closed_loop=closed_loop), creep(creep_protocol(0.5), seed=1)).floor
    assert 0.8 * 0.01 < found.total < 1.6 * 0.01
    assert found.ou > 0.5 * 0.008


def test_of_an_exact_force_the_displacement_tells_the_noise():
    """A sensor of 5 um with a weight: stiffness times that."""
    test = creep(noise=NOISES["none"], rows=2000)
    rng = np.random.default_rng(0)
    shaken = replace(
        test, displacement=test.displacement + 5e-3 * rng.standard_normal(test.time.size)
    )
    floor = prepared(shaken).floor.total
    steepest, least = (B.m * np.exp(B.b * d) for d in (2.2, 1.3))
    assert 5e-3 * least * B.c[0] < floor < 5e-3 * steepest


def test_a_record_begins_with_the_jump():
    found = prepared(creep([Load(1.0, 0.0, 30.0)]))
    motion = jax.tree.map(lambda x: x[0], found.record(found.trials).motion)
    model = Model(Exponential(B.m, B.b), Prony(np.array(B.c), np.array(B.v)))
    assert float(motion.displacement[0]) > 1.0
    force = np.asarray(model.force(motion))
    assert np.max(np.abs(force - 1.0)) < 0.01


def test_a_file_says_what_was_prescribed(tmp_path):
    write_csv(tmp_path / "creep.csv", creep_study({"B": B}, (0.5, 1.0), CORRELATED, 0, 200), [])
    study = read_measurements(tmp_path / "creep.csv")
    assert [test.control for test in study.pad("B").tests] == ["force", "force"]
    assert study.notices == ()
    found = prepare(study.pad("B"))
    assert [trial.control for trial in found.trials] == ["force", "force"]
    assert found.notices == ()
    text = (tmp_path / "creep.csv").read_text().replace("force,B,B-0.5N", "load,B,B-0.5N")
    (tmp_path / "wrong.csv").write_text(text)
    with pytest.raises(InputError, match="control 'load' is unknown"):
        read_measurements(tmp_path / "wrong.csv")


def creeps(constants, seed, closed_loop):
    peak = float(constants.force(np.array([1.2]))[0])
    return [
        replace(
            creep(
                creep_protocol(share * peak), CORRELATED, [seed, k], constants, ROWS, closed_loop
            ),
            control="force",
        )
        for k, share in enumerate((0.3, 0.6))
    ]


@pytest.mark.slow
def test_creep_alone_tells_the_constants():
    # four sds of seven constants fail by chance once in two thousand
    assert max(map(abs, from_truth(B, prepared(*creeps(B, 0, closed_loop=False))).values())) < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["weights", "closed loop", "with a relaxation test"])
def test_intervals_of_creep_tests_hold_the_truth(kind):
    count = 10
    inside = []
    for seed in range(count):
        constants = draw_constants(np.random.default_rng([77, seed]))
        tests = creeps(constants, seed, kind == "closed loop")
        if kind == "with a relaxation test":
            tests.append(pressed(paper_protocol(20.0), seed, constants))
        inside.append([abs(z) < 1.645 for z in from_truth(constants, prepared(*tests)).values()])
    # 90 % of pads by 7 constants that hang together: at least as many as 10 pads hold by chance
    assert np.mean(inside) > 0.9 - 3.0 * np.sqrt(0.09 / count)
