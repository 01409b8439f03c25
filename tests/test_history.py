"""What has not relaxed in a pause goes on in the next test."""

from dataclasses import fields, replace

import jax.numpy as jnp
import numpy as np
import pytest

from qlvbayes.data import Test
from qlvbayes.effects.catalogue import find
from qlvbayes.elastic import Exponential
from qlvbayes.kinematics.trajectory import Trajectory
from qlvbayes.model import Model
from qlvbayes.motion import Motion
from qlvbayes.records.past import REST, past_of
from qlvbayes.relaxation import Prony
from qlvbayes.synthetic import (
    Constants,
    HiddenPad,
    Hold,
    Move,
    Pad,
    Platen,
    draw_effect,
    full_retraction_protocol,
    join_programs,
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


def sequence(programs, *, acceleration=AT_ONCE, return_speed=RETURN, pause=PAUSE, time=None):
    """The whole motion, and the last test's own, times (s) and what it remembers."""
    whole = join_programs(
        programs, pause, return_speed=return_speed, acceleration_limit=acceleration
    )
    platens, tests = [], []
    for name, begin, end in zip(whole.names, whole.begins, whole.ends, strict=True):
        program = tuple(programs[name])
        if return_speed is None and begin > 0.0:
            program = (Hold(end - begin),)
        platens.append(Platen(program, acceleration))
        time = dense(platens[-1])
        tests.append(Test(name, "P", time, time, time, start_s=begin, start_known=True))
    paths = [path_of(platen) for platen in platens]
    past = past_of(len(tests) - 1, tests, paths, 30.0)
    return whole, platens[-1], tests[-1].time, past


def differences(programs, model, pad, *, acceleration=AT_ONCE):
    """(n,) what the earlier tests add to the last one's force: by the model, by the equations."""
    whole, platen, time, past = sequence(programs, acceleration=acceleration)
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
def test_an_effect_on_depth_or_time_acts_on_the_past_too(name):
    effect = draw_effect(name, np.random.default_rng(1), 1.4, 1.6, 30.0, 0.06, SLOW)
    pad = HiddenPad(SLOW, (effect,))
    model = plain(bonded=False) + own(effect)
    found, true, peak = differences(FULL, model, pad, acceleration=1000.0)
    unheeded, _, _ = differences(FULL, plain(bonded=False), pad, acceleration=1000.0)
    error = np.max(np.abs(found - true)) / peak
    print(name, error, np.max(np.abs(unheeded-true))/peak)
    assert error < 1e-5
    assert np.max(np.abs(unheeded - true)) > 1e-3 * peak
