"""What readings show without a model: named where it is there, and never beyond doubt elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from support.hidden_pads import hidden_pad
from support.motions import steered
from support.solids import made_ready, solid

from qlvbayes.diagnosis.searchsetup import protocol_of
from qlvbayes.effects.drags import Inertia
from qlvbayes.io.data import Test
from qlvbayes.motion.evidence import direct_evidence, with_mass
from qlvbayes.report.firstlook import look_at
from qlvbayes.simulate import PROTOCOLS

NOISE = 1e-3  # N
MASS = 7e-4  # N s2/mm


def seen(experiment, *, bonded=False):
    return {one.effect: one for one in direct_evidence(experiment, bonded)}


def beyond_doubt(experiment, *, bonded=False):
    return {name for name, one in seen(experiment, bonded=bonded).items() if one.beyond_doubt}


def pressed(force_of, speeds=(2.0, 10.0), **press):
    """The tests of a pad at some speeds, its force a function of time, depth, speed, rate.

    The platen moves back farther than it came.
    """
    press = {"ramp_up": 0.05, "stroke": 2.0, "back": 2.4, "rest": 3.0} | press
    rng, tests = np.random.default_rng(0), []
    for speed in speeds:
        time, *motion = steered(speed, **press)
        at = np.arange(0.0, time[-1], 0.01)
        depth = np.round(np.interp(at, time, motion[0]), 3)
        force = np.interp(at, time, force_of(time, *motion))
        force += NOISE * rng.standard_normal(at.size)
        tests.append(Test(f"{speed:g}", "p", at, depth, force, role="validate"))
    return made_ready(*tests)


def spring(depth):
    return 0.5 * np.maximum(depth, 0.0)


def glued(time, depth, *_):
    """The force of a pad that relaxes, and that is not left."""
    return solid(time, depth, 0.3, 0.2, 0.5)


def rubbed(speed):
    """0.1 N of Dahl's friction over a way of 0.02 mm."""
    turned, z = np.empty(speed.size), 0.0
    for k, v in enumerate(speed):
        z += 1e-3 * v / 0.02 * (1.0 - z * np.sign(v))
        turned[k] = z
    return 0.1 * turned


@pytest.mark.parametrize("protocol", sorted(PROTOCOLS))
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.few(2)
def test_nothing_is_beyond_doubt_on_an_empty_pad(protocol, seed):
    experiment = hidden_pad(rates=(1.0, 20.0), protocol=PROTOCOLS[protocol], seed=seed)
    assert beyond_doubt(experiment) == set()


def test_nothing_is_beyond_doubt_on_a_spring_that_is_left():
    assert beyond_doubt(pressed(lambda _, depth, *__: spring(depth))) == set()


def test_a_pad_that_sticks_pulls_beyond_doubt_and_one_that_is_bonded_may():
    sticks = lambda _, depth, *__: spring(depth) + 0.3 * np.minimum(depth, 0.0)  # noqa: E731
    holds = lambda *motion: np.where(motion[1] > -0.8, sticks(*motion), 0.0)  # noqa: E731
    experiment = pressed(holds, speeds=(1.0, 4.0), back=4.0)
    assert beyond_doubt(experiment) == {"adhesion"}
    assert seen(experiment)["adhesion"].value == pytest.approx(0.24, abs=0.04)
    assert seen(experiment, bonded=True) == {}


@pytest.mark.parametrize("power", [0.5, 1.0])
@pytest.mark.few(1)
def test_a_drag_pulls_but_not_beyond_doubt(power):
    drags = lambda v: 0.05 * np.sign(v) * np.abs(v) ** power  # noqa: E731
    experiment = pressed(lambda _, depth, v, __: spring(depth) + drags(v))
    assert seen(experiment)["adhesion"].beyond_doubt is False
    assert beyond_doubt(experiment) == set()


def test_a_mass_in_air_is_measured_and_told_in_a_look():
    experiment = pressed(lambda _, __, ___, a: MASS * a, stroke=10.0, back=10.0)
    (mass,) = look_at(experiment, bonded=False).direct_evidence
    assert (mass.effect, mass.beyond_doubt, mass.unit) == ("inertia", True, "N s2/mm")
    assert mass.value == pytest.approx(MASS, rel=0.15)
    assert "moving mass" in mass.sentence


@pytest.mark.parametrize(
    ("left", "air", "speeds", "press"),
    [
        (1.0, 0.0, (1.0, 4.0), {"back": 4.0}),
        (0.5, 0.0, (1.0, 4.0), {"back": 4.0}),
        (0.6, 0.6, (0.5, 1.0, 2.0), {"stroke": 3.0, "back": 2.0}),  # it rubs on the way in
    ],
)
@pytest.mark.few(2)
def test_a_guide_that_rubs_is_neither_a_pull_nor_a_drag(left, air, speeds, press):
    """Friction and a spring, of which a share is left on the way back."""

    def force(_, depth, speed, __):
        return np.where(speed < 0.0, left, 1.0) * spring(depth - air) + rubbed(speed)

    experiment = pressed(force, speeds, **press)
    assert beyond_doubt(experiment) == {"friction"}
    assert seen(experiment)["friction"].value == pytest.approx(0.1, abs=0.01)


def test_a_pull_at_depth_may_be_that_of_a_guide_unless_less_rubs_on_the_way_in():
    """The platen stays in contact, where a pad that relaxed has let go, or is glued."""
    lets_go = lambda *motion: np.maximum(3.0 * glued(*motion), 0.0) + rubbed(motion[2])  # noqa: E731
    holds = lambda time, depth, *_: 3.0 * solid(time, depth**2, 0.3, 0.2, 0.5)  # noqa: E731
    for force, sure in ((lets_go, False), (holds, True)):
        pull = seen(pressed(force, (2.0, 10.0), back=1.7))["adhesion"]
        assert pull.value > 0.05
        assert pull.beyond_doubt is sure
        assert ("guide" in pull.sentence) is not sure


def test_a_drag_in_air_is_no_friction():
    drags = pressed(lambda _, d, v, __: spring(d - 0.6) + 0.05 * v, (1.0, 4.0), stroke=3.0)
    assert "friction" not in beyond_doubt(drags)


def sway(time):
    return 0.05 * np.sin(2.0 * np.pi * 8.0 * time)


def test_a_frame_that_rings_after_stops_is_heard_and_a_hum_is_no_ringing():
    def force(time, depth, speed, _):
        ends = time[1:][(np.abs(speed[1:]) < 1e-9) & (np.abs(speed[:-1]) > 1e-9)]
        since = [np.maximum(time - end, 0.0) for end in ends]
        return spring(depth) + sum(np.exp(-3.0 * after) * sway(after) for after in since)

    experiment = pressed(force)
    assert beyond_doubt(experiment) == {"frame_ringing"}
    assert seen(experiment)["frame_ringing"].value == pytest.approx(0.05, rel=0.3)
    hum = pressed(lambda time, depth, *_: spring(depth) + sway(time))
    assert "frame_ringing" not in seen(hum)


@pytest.mark.parametrize(("delay", "ramp_up"), [(0.02, 0.1), (0.03, 0.1), (0.06, 0.3)])
@pytest.mark.few(1)
def test_a_force_that_follows_stops_late_is_measured(delay, ramp_up):
    """A pad that relaxes, with a drag that is as good as 4 ms less, at 100 readings a second."""

    def force(time, depth, speed, _):
        return glued(time, np.maximum(depth, 0.0)) + 0.002 * speed

    def late(time, *motion):
        return np.interp(time - delay, time, force(time, *motion))

    assert "channel_lag" not in seen(pressed(force, (1.0, 2.0, 4.0), ramp_up=ramp_up))
    experiment = pressed(late, (1.0, 2.0, 4.0), ramp_up=ramp_up)
    assert seen(experiment)["channel_lag"].value == pytest.approx(delay - 0.004, abs=0.002)
    assert "channel_lag" in beyond_doubt(experiment)


def test_a_pull_counts_where_the_record_ends_with_it_and_a_drag_there_is_none():
    lifted = {"speeds": (1.0, 4.0), "back": 1.95, "ends": True}
    assert "adhesion" in beyond_doubt(pressed(glued, **lifted))
    for power, size in ((1.0, 0.02), (0.5, 0.05)):
        drags = lambda v, p=power, c=size: c * np.sign(v) * np.abs(v) ** p  # noqa: E731
        film = pressed(lambda _, d, v, __, drags=drags: spring(d) + drags(v), **lifted)
        assert beyond_doubt(film) == set()


@pytest.mark.parametrize(("ramp_up", "stroke"), [(0.02, 20.0), (0.1, 4.0)])
@pytest.mark.few(1)
def test_a_mass_is_weighed_by_impulses_where_no_acceleration_is_resolved(ramp_up, stroke):
    """Two readings at a start, or moves that reach their speed for a moment only."""
    experiment = pressed(
        lambda _, __, ___, a: MASS * a, (10.0, 35.0), ramp_up=ramp_up, stroke=stroke, back=stroke
    )
    mass, sd = with_mass(experiment).mass
    assert abs(mass - MASS) < 3.0 * sd
    assert sd < 0.1 * MASS
    protocol = protocol_of(with_mass(experiment), bonded=False)
    assert Inertia.unmeasured(replace(protocol, curved=False)) is None
    prior = Inertia.default(with_mass(experiment).scales).mass
    assert prior.log_median == pytest.approx(np.log(mass))
    assert Inertia.unmeasured(replace(protocol, curved=False, mass_shown=False)) is not None
