"""Check that relaxation unfinished in a pause goes on in the next test."""

from dataclasses import fields, replace
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from support.posteriors import build_posterior
from support.sequences import join_programs, record_sequence

from qlvbayes.effects.catalogue import find
from qlvbayes.fitting.fit import fit_pad
from qlvbayes.io.data import Pad as MeasuredPad
from qlvbayes.io.data import Test
from qlvbayes.io.units import PAD
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.relaxation.prony import Prony
from qlvbayes.model.choices import Choices
from qlvbayes.model.model import Model
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.past import REST, past_of, remembered_tests
from qlvbayes.motion.specimen import carryovers
from qlvbayes.motion.trajectory import Trajectory
from qlvbayes.simulate import (
    NOISES,
    Constants,
    HiddenPad,
    Hold,
    Pad,
    Platen,
    draw_effect,
    full_retraction_protocol,
    paper_protocol,
)

SLOW = Constants(m=0.34, b=1.165, c=(0.3, 0.5, 0.2), v=(3.0, 0.05))
PAUSE, AT_ONCE, RETURN = 5.0, 1e8, 1e5  # s, mm/s2, mm/s: the platen goes back in 60 us
CLOSE = 1e-6  # of the peak force
PAPER = {"slow": paper_protocol(1.0), "fast": paper_protocol(20.0), "last": paper_protocol(5.0)}
FULL = {"one": full_retraction_protocol(5.0), "two": full_retraction_protocol(30.0)}


def plain(constants=SLOW, *, bonded=True):
    relaxation = Prony(jnp.array(constants.c), jnp.array(constants.v))
    return Model(Exponential(constants.m, constants.b), relaxation, bonded)


def path_of(platen):
    """The platen's exact motion."""
    rows = [(p.displacement, p.velocity, p.acceleration) for p in platen.pieces]
    knots = [p.start for p in platen.pieces] + [platen.duration]
    return Trajectory(np.array(knots), *np.array(rows).T, 0.0)


def dense(platen):
    even, early = np.linspace(0.0, 1.0, 201), np.linspace(0.0, 1.0, 161) ** 4
    parts = [p.start + p.duration * (even if p.velocity else early) for p in platen.pieces]
    return np.unique(np.concatenate([*parts, [platen.duration]]))


def alone(platen, time):
    along = (platen.displacement(time), platen.velocity(time), platen.acceleration(time))
    return Motion(*map(jnp.asarray, (time, *along)))


def remembering(motion, past):
    still = np.zeros(past.time.size)
    own = (motion.time, motion.displacement, motion.velocity, motion.acceleration)
    before = (past.time, past.displacement, still, still)
    joined = [np.concatenate(pair) for pair in zip(before, own, strict=True)]
    ago = np.concatenate([past.ago, np.zeros(motion.time.size, int)])
    return Motion(*map(jnp.asarray, joined), motion.start, jnp.asarray(ago))


def sequence(programs, acceleration=AT_ONCE):
    """The whole motion, and the last test's own, times (s) and what it remembers."""
    whole = join_programs(programs, PAUSE, return_speed=RETURN, acceleration_limit=acceleration)
    platens, tests = [], []
    for name, begin in zip(whole.names, whole.begins, strict=True):
        platens.append(Platen(tuple(programs[name]), acceleration))
        time = dense(platens[-1])
        tests.append(Test(name, "P", time, time, time, start_s=begin, start_known=True))
    paths = [path_of(platen) for platen in platens]
    past = past_of(len(tests) - 1, tests, paths, 30.0)
    return whole, platens[-1], tests[-1].time, past


def differences(programs, model, pad, *, acceleration=AT_ONCE):
    """(n,) what the earlier tests add to the last one's force: by the model, by the equations."""
    whole, platen, time, past = sequence(programs, acceleration)
    motion = alone(platen, time)
    carried = np.asarray(model.force(remembering(motion, past)))[past.time.size :]
    own = np.asarray(model.force(motion))
    inside = np.clip(whole.begins[-1] + time, None, whole.platen.duration)
    true = pad.force(whole.platen, inside) - pad.force(platen, time)
    return carried - own, true, own.max()


@pytest.mark.parametrize("programs", [PAPER, FULL])
def test_the_past_adds_what_the_equations_add(programs):
    """Solved by a stiff integrator through the pauses, a mode of 0.05/s after 5 s."""
    found, true, peak = differences(programs, plain(), Pad(SLOW, bonded=True))
    assert np.max(np.abs(true)) > 0.01 * peak
    assert np.max(np.abs(found - true)) < CLOSE * peak


def own(effect):
    """The model's effect of the same constants as a simulated one."""
    kind = find(effect.name)
    return kind(**{field.name: getattr(effect, field.name) for field in fields(kind)})


@pytest.mark.parametrize("name", ["contact_offset", "frame_compliance", "strain_dependent_rate"])
@pytest.mark.few(1)
def test_an_effect_on_depth_or_time_acts_on_the_past_too(name):
    effect = draw_effect(name, np.random.default_rng(1), 1.4, 1.6, 30.0, 0.06, SLOW)
    pad = HiddenPad(SLOW, (effect,))
    model = plain(bonded=False) + own(effect)
    found, true, peak = differences(FULL, model, pad, acceleration=1000.0)
    unheeded, _, _ = differences(FULL, plain(bonded=False), pad, acceleration=1000.0)
    assert np.max(np.abs(found - true)) < 1e-5 * peak
    assert np.max(np.abs(unheeded - true)) > 1e-3 * peak


PER_TEST = {
    "viscous_drag": {"eta": 0.02},
    "squeeze_film": {"eta": 0.01, "h": 3.0},
    "fluid_pressure": {"k": 0.2, "tau": 0.4, "a": 0.3},
    "friction": {"strength": 0.1, "reach": 0.05},
    "stress_softening": {"s": 0.3},
    "fluid_leak": {"rate": 1e-3},
    "force_drift": {"rate": 1e-3},
    "inertia": {"mass": 1e-4},
    "channel_lag": {"delay": 0.02},
}


@pytest.mark.parametrize("name", PER_TEST)
@pytest.mark.few(1)
def test_what_an_effect_adds_to_a_relaxed_pad_is_that_of_the_test_alone(name):
    """The modes here relax within a pause: then nothing that came before it matters."""
    _, platen, time, past = sequence(PAPER)
    motion = replace(alone(platen, time), start=jnp.asarray(500.0))
    quick = Constants(m=0.34, b=1.165, c=(0.3, 0.5, 0.2), v=(20.0, 15.0))
    model = plain(quick, bonded=False) + find(name)(**PER_TEST[name])
    before = np.asarray(model.force(motion))
    after = np.asarray(model.force(remembering(motion, past)))[past.time.size :]
    np.testing.assert_allclose(after, before, atol=1e-12 * before.max())
    assert np.max(np.abs(before - np.asarray(plain(quick, bonded=False).force(motion)))) > 1e-3


def test_a_platen_that_stays_keeps_pressing_through_the_pause():
    """A test that holds where the one before ended is the end of one long test."""
    programs = {"press": paper_protocol(5.0), "wait": (Hold(20.0),)}
    whole = join_programs(programs, PAUSE, return_speed=None)
    first = Platen(tuple(programs["press"]))
    time = np.linspace(0.0, 20.0, 60)
    rest = Trajectory(np.array([0.0, 20.0]), *np.array([[0.8], [0.0], [0.0]]), 0.0)
    tests = [
        Test("press", "P", dense(first), dense(first), dense(first), start_known=True),
        Test("wait", "P", time, time, time, start_s=whole.begins[1], start_known=True),
    ]
    past = past_of(1, tests, [path_of(first), rest], 30.0)
    assert past.stays
    depth = np.full(time.size, 0.8)
    motion = remembering(Motion(*map(jnp.asarray, (time, depth, 0 * time, 0 * time))), past)
    found = np.asarray(plain().force(motion))[past.time.size :]
    true = Pad(SLOW, bonded=True).force(
        whole.platen, np.minimum(whole.begins[1] + time, whole.ends[1])
    )
    np.testing.assert_allclose(found, true, atol=1e-6 * 2.0)


@pytest.mark.parametrize(
    ("starts", "known", "remembered"),
    [
        ((0.0, 65.0, 125.0 + REST * 30.0, 190.0 + REST * 30.0), True, [2]),
        ((0.0, 65.0, 130.0), True, [1, 0]),
        ((0.0, 60.0 + REST * 30.0), True, []),
        ((0.0, 65.0), False, []),  # an unknown clock
        ((0.0, 30.0), True, []),  # an impossible one
    ],
)
def test_a_pause_that_is_rest_or_a_clock_that_is_none_ends_the_memory(starts, known, remembered):
    time = np.linspace(0.0, 60.0, 20)
    tests = [Test("T", "P", time, time, time, start_s=start, start_known=known) for start in starts]
    assert remembered_tests(len(tests) - 1, tests, 30.0) == remembered


@cache
def measured(known=True, carried=True):
    """Tests 5 s after one another on a pad of two modes, as a file would give them."""
    programs = {f"{rate:g}": paper_protocol(rate) for rate in (1.0, 20.0, 5.0)}
    found = record_sequence(
        Pad(SLOW), programs, NOISES["white"], 3, pause_s=PAUSE, continuous=carried, max_rows=400
    )
    tests = (
        Test(t.name, "P", t.record.time, t.record.displacement, t.record.force, start_s=t.start_s,
             start_known=known)
        for t in found
    )  # fmt: skip
    return MeasuredPad("P", tuple(tests), PAD)


@cache
def experiment(known=True):
    return prepare(measured(known), all_tests=True)


def test_rested_gives_the_record_of_tests_from_rest_and_blocks_stay_those_of_the_test():
    known, unknown = experiment(), experiment(known=False)
    rested = build_posterior(known, Choices(rested=True), known.trials)
    before = build_posterior(unknown, Choices(), unknown.trials)
    carried = build_posterior(known, Choices(), known.trials)
    assert rested.record.motion.ago is None
    assert carried.record.motion.ago is not None
    theta = np.linspace(-0.3, 0.3, before.size)[None]
    assert rested.log_density(theta) == before.log_density(theta)
    assert carried.log_density(theta) != before.log_density(theta)
    for k in range(3):
        one, other = (
            np.asarray(record.motion.time)[k][np.asarray(record.nodes)[k]]
            for record in (carried.record, rested.record)
        )
        np.testing.assert_array_equal(one, other)


@cache
def fitted(rested):
    choices = Choices(noise="white", rested=rested)
    return fit_pad(experiment(), choices, method="least-squares")


@pytest.mark.slow
def test_constants_are_found_where_tests_from_rest_would_bend_them():
    truth = {"m": SLOW.m, "b": SLOW.b, "c[2]": SLOW.c[2], "v[2]": SLOW.v[1]}
    carried, rested = fitted(False).summary(), fitted(True).summary()
    for name, value in truth.items():
        assert abs(carried[name].mean - value) < 4.0 * carried[name].sd, name
    assert abs(rested["c[2]"].mean - SLOW.c[2]) > 8.0 * carried["c[2]"].sd
    assert fitted(True).facts["residual_sd"] > 3.0 * fitted(False).facts["residual_sd"]


def test_the_share_that_is_told_is_that_of_the_equations():
    whole = experiment()
    posterior = build_posterior(whole, Choices(noise="white"), whole.trials)
    constants = np.array([[SLOW.m, SLOW.b, *SLOW.c, *SLOW.v, NOISES["white"].white]])

    def predict(record):
        return posterior.over(record).forces(constants)[0]

    _, second = carryovers(whole, whole.trials, posterior.record, predict)
    with_it, without = (measured(carried=c).tests[2].force for c in (True, False))
    # the noise of both is the same
    true = np.max(np.abs(with_it - without)) / np.max(measured().tests[1].force)
    assert second.share == pytest.approx(true, rel=0.05)
    assert second.pause == pytest.approx(PAUSE)
