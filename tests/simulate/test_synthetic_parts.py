"""Constants, platen, encoder, load cell and logger of the simulated rig do what they state."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qlvbayes.io.checks import InputError
from qlvbayes.simulate import (
    NOISES,
    PAPER_RATES,
    SPECIMENS,
    TABLE_1,
    Constants,
    Hold,
    Move,
    Noise,
    Platen,
    draw_constants,
    encode,
    paper_protocol,
    specimens_of,
    thin,
)


def test_random_pads_stay_in_the_papers_ranges_and_specimens_are_alike_not_the_same():
    rng = np.random.default_rng(3)
    drawn = [draw_constants(rng) for _ in range(2000)]
    for values, low, high in [
        ([p.m for p in drawn], 0.2, 1.2),
        ([p.b for p in drawn], 0.3, 1.5),
        ([p.v[0] for p in drawn], 2.0, 15.0),
        ([p.v[1] for p in drawn], 0.05, 0.5),
    ]:
        place = np.log(np.array(values) / low) / np.log(high / low)
        assert place.min() >= 0
        assert place.max() <= 1
        # Log-uniform: the mean place is 1/2 within 5 standard errors.
        assert abs(place.mean() - 0.5) < 5 * np.sqrt(1 / 12 / len(values))
    assert min(min(p.c) for p in drawn) >= 0.03
    rng = np.random.default_rng(0)
    found, kinds = specimens_of(["B", "finger:40"], rng)
    assert found["B"] == TABLE_1["B"]
    assert kinds == {f"finger-{k}": "finger" for k in range(1, 41)}
    stiffness = np.log([found[name].m / SPECIMENS["finger"].m for name in kinds])
    # 40 draws of an sd of 0.2: their mean and sd to three errors
    assert abs(stiffness.mean()) < 3.0 * 0.2 / np.sqrt(40)
    assert stiffness.std() == pytest.approx(0.2, abs=3.0 * 0.2 / np.sqrt(80))
    assert len({found[name].v for name in kinds}) == 40


MOVES = st.builds(Move, st.floats(0.0, 3.0), st.floats(0.01, 200.0))
HOLDS = st.builds(Hold, st.floats(0.001, 50.0))
PROGRAMS = st.lists(MOVES | HOLDS, min_size=1, max_size=6)


def protocol(rate: float) -> Platen:
    return Platen(paper_protocol(rate))


@given(program=PROGRAMS, limit=st.floats(10.0, 5000.0))
@settings(max_examples=20, deadline=None)
def test_motion_is_continuous_and_within_speed_and_acceleration(program, limit):
    try:
        platen = Platen(tuple(program), acceleration_limit=limit)
    except InputError:
        assert all(isinstance(step, Move) and step.target == 0.0 for step in program)
        return
    pieces = platen.pieces
    for this, following in pairwise(pieces):
        t, d, v, a = this.duration, this.displacement, this.velocity, this.acceleration
        assert following.start == pytest.approx(this.start + t, abs=1e-12)
        assert following.displacement == pytest.approx(d + v * t + 0.5 * a * t * t, abs=1e-9)
        assert following.velocity == pytest.approx(v + a * t, abs=1e-6)
    assert all(abs(piece.acceleration) <= limit for piece in pieces)
    top = max((step.speed for step in program if isinstance(step, Move)), default=0.0)
    assert all(abs(piece.velocity) <= top for piece in pieces)
    targets = [step.target for step in program if isinstance(step, Move)]
    assert platen.displacement(platen.duration) == pytest.approx(
        targets[-1] if targets else 0.0, abs=1e-9
    )


@pytest.mark.parametrize("rate", PAPER_RATES)
def test_velocity_is_the_slope_of_displacement_and_kinks_are_where_the_acceleration_jumps(rate):
    platen = protocol(rate)
    edges = np.append(platen.kinks, platen.duration)
    middle, step = 0.5 * (edges[1:] + edges[:-1]), 0.25 * np.diff(edges)
    for whole, slope in (("displacement", "velocity"), ("velocity", "acceleration")):
        along, rising = getattr(platen, whole), getattr(platen, slope)
        rise = along(middle + step) - along(middle - step)
        assert rise == pytest.approx(2.0 * step * rising(middle), abs=1e-9)
    jumps = platen.acceleration(platen.kinks + 1e-7) - platen.acceleration(platen.kinks - 1e-7)
    assert np.allclose(np.abs(jumps), np.where(platen.kinks == 0.04, 2000.0, 1000.0))
    assert platen.kinks.size == (7 if rate == 100.0 else 8)
    reached = min(rate, 40.0)  # the stroke of the paper is too short for 100 mm/s
    assert platen.velocity(platen.kinks).max() == pytest.approx(reached, rel=1e-12)


def test_a_ramp_lasts_its_time_and_the_platen_rests_outside():
    assert protocol(20.0).duration == pytest.approx((0.08 + 0.02) + 30 + (0.8 + 0.001) + 30)
    platen = protocol(10.0)
    outside = np.array([-1.0, platen.duration + 1.0])
    assert platen.displacement(outside) == pytest.approx([0.0, 0.8])
    assert not platen.velocity(outside).any()
    assert not platen.acceleration(outside).any()


TIMES = np.array([0.0, 0.001, 0.1, 0.5, 1.5, 6.0])
# Every bound is 5 standard errors: a false alarm in about 1 of 10^6 comparisons.
Z = 5.0


@pytest.mark.parametrize("kind", ["correlated", "white"])
def test_noise_has_the_stated_covariance_at_uneven_times(kind):
    noise = NOISES[kind]
    rng = np.random.default_rng(11)
    draws = np.array([noise.draw(TIMES, rng) for _ in range(20_000)])
    lags = np.abs(TIMES[:, None] - TIMES)
    expected = noise.correlated**2 * np.exp(-lags / noise.correlation_time)
    expected += noise.white**2 * np.eye(TIMES.size)
    spread = np.diag(expected)
    error = np.sqrt((np.outer(spread, spread) + expected**2) / len(draws))
    assert np.all(np.abs(draws.T @ draws / len(draws) - expected) < Z * error)
    assert np.all(np.abs(draws.mean(axis=0)) < Z * np.sqrt(spread / len(draws)))


@given(st.lists(st.floats(-2.0, 2.0), min_size=1), st.sampled_from([0.001, 0.01]))
def test_the_encoder_is_at_most_half_a_step_off(displacement, step):
    true = np.array(displacement)
    read = encode(true, step)
    assert np.all(np.abs(read - true) <= 0.5 * step * (1 + 1e-9))
    assert np.allclose(read / step, np.round(read / step), atol=1e-9)


def sampled(program):
    platen = Platen(program)
    time = np.arange(int(platen.duration * 1000) + 1) / 1000
    return platen, time, encode(platen.displacement(time))


@pytest.mark.parametrize("max_rows", [40, 500, 5000])
@pytest.mark.parametrize("rate", [0.1, 20.0, 100.0])
def test_rows_are_few_ascending_and_include_both_ends(rate, max_rows):
    _, time, displacement = sampled(paper_protocol(rate))
    kept = thin(time, displacement, max_rows)
    assert 0.8 * max_rows < kept.size <= max_rows
    assert kept[0] == 0
    assert kept[-1] == time.size - 1
    assert np.all(np.diff(kept) > 0)


@pytest.mark.parametrize("rate", PAPER_RATES)
def test_intervals_grow_with_the_time_since_the_stop_but_for_runs_of_consecutive_samples(rate):
    platen, time, displacement = sampled(paper_protocol(rate))
    kept = thin(time, displacement, 500)
    for stop in platen.kinks[[-5, -1]]:
        late = kept[(time[kept] > stop + 2) & (time[kept] < stop + 29)]
        assert np.sum(np.diff(late) == 1) >= 10
    stop = platen.kinks[-5]
    hold = time[kept][(time[kept] >= stop) & (time[kept] <= stop + 30)] - stop
    assert np.all(np.diff(hold) < 0.1 * (hold[:-1] + 0.02) + 0.001)  # and a sample of rounding
    assert hold[0] < 0.01
    assert hold[-1] > 27
    ramp = displacement[kept][time[kept] <= stop]
    assert np.abs(np.diff(ramp)).max() < 0.041  # 1 ms at 40 mm/s, the least there is


def test_a_record_without_holds_or_without_motion_is_thinned_too():
    _, time, displacement = sampled((Move(1.0, 0.5), Move(0.0, 0.5), Move(1.6, 1.0)))
    assert 80 < thin(time, displacement, 100).size <= 100
    _, time, displacement = sampled((Hold(10.0),))
    assert 80 < thin(time, displacement, 100).size <= 100


def specimen(word):
    return specimens_of([word], np.random.default_rng(0))


@pytest.mark.parametrize(
    "build",
    [
        lambda: Constants(-1.0, 0.5, (1.0,), ()),
        lambda: Constants(1.0, 0.0, (1.0,), ()),
        lambda: Constants(1.0, 0.5, (0.5, 0.4), (1.0,)),
        lambda: Constants(1.0, 0.5, (1.2, -0.2), (1.0,)),
        lambda: Constants(1.0, 0.5, (0.5, 0.5), ()),
        lambda: Constants(1.0, 0.5, (0.5, 0.5), (0.0,)),
        lambda: Constants(float("nan"), 0.5, (1.0,), ()),
        *(partial(specimen, word) for word in ("D", "finger:0", "finger:two", "finger:", "hand:3")),
        lambda: Move(1.0, 0.0),
        lambda: Move(float("nan"), 1.0),
        lambda: Hold(0.0),
        lambda: Platen(()),
        lambda: Platen((Move(0.0, 1.0),)),
        lambda: Platen((Hold(1.0),), acceleration_limit=0.0),
        lambda: Noise(-1.0, 0.0, 1.0),
        lambda: Noise(0.0, -1.0, 1.0),
        lambda: Noise(0.0, 0.0, 0.0),
        lambda: thin(*sampled(paper_protocol(1.0))[1:], 32),  # of 33 at the least
    ],
)
def test_what_no_rig_can_be_is_refused(build):
    with pytest.raises(InputError):
        build()
