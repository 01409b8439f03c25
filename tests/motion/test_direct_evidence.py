"""What readings show without a model: named where it is there, and never beyond doubt elsewhere."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qlvbayes.diagnosis.searchsetup import protocol_of
from qlvbayes.effects.drags import Inertia
from qlvbayes.io.data import Pad, Test, read_measurements
from qlvbayes.io.units import UnitSystem
from qlvbayes.motion.evidence import direct_evidence, with_mass
from qlvbayes.motion.experiment import prepare
from qlvbayes.report.firstlook import look_at
from qlvbayes.simulate import PROTOCOLS
from tests.support.hidden_pads import hidden_pad

AWAY = Path(__file__).parents[3] / "shared" / "away"  # made by others
REAL = AWAY.parent / "real" / "adhesive_shear.csv"
NOISE = 1e-3  # N
MASS = 7e-4  # N s2/mm


def seen(experiment, *, bonded=False):
    return {one.effect: one for one in direct_evidence(experiment, bonded)}


def beyond_doubt(experiment, *, bonded=False):
    return {name for name, one in seen(experiment, bonded=bonded).items() if one.beyond_doubt}


def a_press(speed, *, ramp_up=0.05, stroke=2.0, back=2.4, rest=3.0):
    """A platen that presses, holds and moves back farther than it came: time, motion."""
    step = 1e-3
    duration = lambda length: length / speed + ramp_up  # noqa: E731
    move = lambda length: np.interp(  # noqa: E731
        np.arange(0.0, duration(length), step),
        [0.0, ramp_up, duration(length) - ramp_up, duration(length)],
        [0.0, speed, speed, 0.0],
    )
    still = np.zeros(round(rest / step))
    velocity = np.concatenate([still, move(stroke), still, -move(back), still])
    displacement = step * np.cumsum(velocity)
    time = step * np.arange(velocity.size)
    return time, displacement, velocity, np.gradient(velocity, step)


def pressed(force_of, speeds=(2.0, 10.0), *, seed=0, **press):
    """The tests of a pad at some speeds, its force a function of time, depth, speed, rate."""
    rng, tests = np.random.default_rng(seed), []
    for speed in speeds:
        time, *motion = a_press(speed, **press)
        at = np.arange(0.0, time[-1], 0.01)
        force = np.interp(at, time, force_of(time, *motion))
        tests.append(
            Test(
                name=f"{speed:g}", pad="p", time=at, role="validate",
                displacement=np.round(np.interp(at, time, motion[0]), 3),
                force=force + NOISE * rng.standard_normal(at.size),
            )
        )  # fmt: skip
    return prepare(Pad("p", tuple(tests), UnitSystem("mm", "N")))


def spring(depth):
    return 0.5 * np.maximum(depth, 0.0)


@pytest.mark.parametrize("protocol", sorted(PROTOCOLS))
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.few(4)
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
def test_a_drag_pulls_but_not_beyond_doubt(power):
    drags = lambda v: 0.05 * np.sign(v) * np.abs(v) ** power  # noqa: E731
    experiment = pressed(lambda _, depth, v, __: spring(depth) + drags(v))
    assert seen(experiment)["adhesion"].beyond_doubt is False
    assert beyond_doubt(experiment) == set()


def test_a_mass_in_air_is_measured():
    experiment = pressed(lambda _, __, ___, a: MASS * a, stroke=10.0, back=10.0)
    assert beyond_doubt(experiment) == {"inertia"}
    mass = seen(experiment)["inertia"]
    assert mass.value == pytest.approx(MASS, rel=0.15)
    assert mass.unit == "N s2/mm"


@pytest.mark.parametrize("lost", [0.0, 0.5])
def test_a_guide_that_rubs_is_neither_a_pull_nor_a_drag(lost):
    """0.1 N of Dahl's friction, and a spring of which something has relaxed when it is left."""

    def force(_, depth, speed, __):
        turned, z = np.empty(depth.size), 0.0
        for k in range(depth.size):
            z += 1e-3 * speed[k] / 0.02 * (1.0 - z * np.sign(speed[k]))
            turned[k] = z
        return np.where(speed < 0.0, 1.0 - lost, 1.0) * spring(depth) + 0.1 * turned

    experiment = pressed(force, speeds=(1.0, 4.0), back=4.0)
    assert beyond_doubt(experiment) == {"friction"}
    assert seen(experiment)["friction"].value == pytest.approx(0.1, abs=0.01)


def test_a_guide_that_rubs_on_the_way_in_pulls_on_the_way_back():
    """0.1 N of Dahl's friction over 0.6 mm of air; the pad relaxes and the platen leaves it."""

    def force(_, depth, speed, __):
        turned, z = np.empty(depth.size), 0.0
        for k in range(depth.size):
            z += 1e-3 * speed[k] / 0.02 * (1.0 - z * np.sign(speed[k]))
            turned[k] = z
        return np.where(speed < 0.0, 0.6, 1.0) * spring(depth - 0.6) + 0.1 * turned

    experiment = pressed(force, speeds=(0.5, 1.0, 2.0), stroke=3.0, back=2.0)
    assert beyond_doubt(experiment) == {"friction"}
    assert seen(experiment)["friction"].value == pytest.approx(0.1, abs=0.01)
    drags = pressed(lambda _, d, v, __: spring(d - 0.6) + 0.05 * v, speeds=(1.0, 4.0), stroke=3.0)
    assert "friction" not in beyond_doubt(drags)


def test_a_frame_that_rings_after_stops_is_heard():
    def force(time, depth, speed, _):
        ends = time[1:][(np.abs(speed[1:]) < 1e-9) & (np.abs(speed[:-1]) > 1e-9)]
        rings = [
            np.where(time > end, 0.05 * np.exp(-3.0 * (time - end)), 0.0)
            * np.sin(2.0 * np.pi * 8.0 * (time - end))
            for end in ends
        ]
        return spring(depth) + sum(rings)

    experiment = pressed(force)
    assert beyond_doubt(experiment) == {"frame_ringing"}
    assert seen(experiment)["frame_ringing"].value == pytest.approx(0.05, rel=0.3)


def test_a_hum_that_goes_on_is_no_ringing():
    def force(time, depth, speed, _):
        return spring(depth) + 0.05 * np.sin(2.0 * np.pi * 8.0 * time)

    assert "frame_ringing" not in seen(pressed(force))


def glued(time, depth, *_):
    """The force of a pad that relaxes, and that is not left."""
    relaxed = np.zeros(depth.size)
    for k in range(1, depth.size):
        step = depth[k] - depth[k - 1]
        relaxed[k] = np.exp(-(time[k] - time[k - 1]) / 0.5) * (relaxed[k - 1] + step)
    return 0.3 * depth + 0.2 * relaxed


def late(force_of, delay):
    """A channel of force that is late by a time (s)."""
    return lambda time, *motion: np.interp(time - delay, time, force_of(time, *motion))


@pytest.mark.parametrize(("delay", "ramp_up"), [(0.02, 0.1), (0.03, 0.1), (0.06, 0.3)])
def test_a_force_that_follows_stops_late_is_measured(delay, ramp_up):
    """A pad that relaxes, with a drag that is as good as 4 ms less, at 100 readings a second."""

    def force(time, depth, speed, _):
        return glued(time, np.maximum(depth, 0.0)) + 0.002 * speed

    plain = {"speeds": (1.0, 2.0, 4.0), "ramp_up": ramp_up}
    assert "channel_lag" not in seen(pressed(force, **plain))
    experiment = pressed(late(force, delay), **plain)
    assert seen(experiment)["channel_lag"].value == pytest.approx(delay - 0.004, abs=0.002)
    assert "channel_lag" in beyond_doubt(experiment)


@pytest.mark.parametrize(("drifts", "told"), [(2e-4, True), (0.0, False)])
def test_a_force_before_contact_that_grows_with_the_clock_is_measured(drifts, told):
    """Four presses a hundred seconds apart, whose load cell drifts by 0.2 mN a second."""
    trials = pressed(lambda _, depth, *__: spring(depth), speeds=(1.0, 2.0, 3.0, 4.0)).trials
    later = [
        replace(one, force=one.force + drifts * (start + one.time), start_s=start, start_known=True)
        for start, one in zip((0.0, 100.0, 200.0, 300.0), (t.test for t in trials), strict=True)
    ]
    experiment = prepare(Pad("p", tuple(later), UnitSystem("mm", "N")))
    assert ("force_drift" in seen(experiment)) is told
    assert ("force_drift" in beyond_doubt(experiment)) is told
    if told:
        assert seen(experiment)["force_drift"].value == pytest.approx(drifts, rel=0.05)


@pytest.mark.parametrize(("pause", "told"), [(600.0, True), (20.0, False)])
def test_a_later_loading_is_lower_beyond_what_a_relaxation_of_any_time_may_leave(pause, told):
    """A tenth is lost from the first test to the second, which a slow mode may also do at first."""
    (trial,) = pressed(lambda _, depth, *__: spring(depth), speeds=(2.0,)).trials
    later = replace(
        trial.test, name="later", force=0.9 * trial.test.force, start_s=pause, start_known=True
    )
    experiment = prepare(Pad("p", (trial.test, later), UnitSystem("mm", "N")))
    assert ("stress_softening" in seen(experiment)) is told
    assert beyond_doubt(experiment) == set()


def without_the_last_rest(experiment):
    stops = [trial.phases[-1].start for trial in experiment.trials]
    tests = []
    for trial, stop in zip(experiment.trials, stops, strict=True):
        kept, test = trial.test.time < stop, trial.test
        tests.append(
            replace(
                test, time=test.time[kept], displacement=test.displacement[kept],
                force=test.force[kept],
            )
        )  # fmt: skip
    return prepare(Pad("p", tuple(tests), experiment.units))


def test_a_pull_counts_where_the_record_ends_with_it_and_a_drag_there_is_none():
    assert "adhesion" in beyond_doubt(without_the_last_rest(pressed(glued, (1.0, 4.0), back=1.95)))
    for drag in (lambda v: 0.02 * v, lambda v: 0.05 * np.sign(v) * np.abs(v) ** 0.5):
        film = pressed(
            lambda _, depth, v, __, drag=drag: spring(depth) + drag(v), (1.0, 4.0), back=1.95
        )
        assert beyond_doubt(without_the_last_rest(film)) == set()


@pytest.mark.parametrize(("pad", "there"), [("updown", {"adhesion"}), ("stairs", set())])
def test_a_strip_that_is_sheared_back_pulls(pad, there):
    """A glued strip: a loose specimen cannot pull by a quarter of its peak."""
    if not REAL.exists():
        pytest.skip("the records are not here")
    (known,) = (one for one in read_measurements(REAL).pads if one.name == pad)
    assert beyond_doubt(prepare(known)) == there


def test_it_is_part_of_a_look_in_words_and_in_its_file():
    experiment = pressed(lambda _, __, ___, a: MASS * a, stroke=10.0, back=10.0)
    (found,) = look_at(experiment, bonded=False).direct_evidence
    assert found.beyond_doubt
    assert "moving mass" in found.sentence


@pytest.mark.parametrize(
    ("name", "there"),
    [pytest.param("air.csv.gz", {"inertia"}, marks=pytest.mark.slow),
     pytest.param("sticky.csv.gz", {"adhesion"}, marks=pytest.mark.slow),
     ("pulls.csv", {"adhesion"}), ("film.csv", set()), ("drag.csv", set())],
)  # fmt: skip
def test_records_that_others_made(name, there):
    if not AWAY.exists():
        pytest.skip("the records are not here")
    (pad,) = read_measurements(AWAY / name).pads
    assert beyond_doubt(prepare(pad)) == there


@pytest.mark.parametrize(("ramp_up", "stroke"), [(0.02, 20.0), (0.1, 4.0)])
def test_a_mass_is_weighed_by_impulses_where_no_acceleration_is_resolved(ramp_up, stroke):
    """Two readings at a start, or moves that reach their speed for a moment only."""
    experiment = pressed(
        lambda _, __, ___, a: MASS * a, (10.0, 35.0), ramp_up=ramp_up, stroke=stroke, back=stroke
    )
    mass, sd = with_mass(experiment).mass
    assert abs(mass - MASS) < 3.0 * sd
    assert sd < 0.1 * MASS
    weighed = protocol_of(with_mass(experiment), bonded=False)
    assert Inertia.unmeasured(replace(weighed, curved=False)) is None
    prior = Inertia.default(with_mass(experiment).scales).mass
    assert prior.log_median == pytest.approx(np.log(mass))
    assert Inertia.unmeasured(replace(weighed, curved=False, weighed=False)) is not None
