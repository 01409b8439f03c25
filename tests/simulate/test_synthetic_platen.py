"""The platen obeys its program, its speed and its acceleration."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qlvbayes.io.checks import InputError
from qlvbayes.simulate import PAPER_RATES, Hold, Move, Platen, paper_protocol

MOVES = st.builds(Move, st.floats(0.0, 3.0), st.floats(0.01, 200.0))
HOLDS = st.builds(Hold, st.floats(0.001, 50.0))
PROGRAMS = st.lists(MOVES | HOLDS, min_size=1, max_size=6)


def protocol(rate: float) -> Platen:
    return Platen(paper_protocol(rate))


@given(program=PROGRAMS, limit=st.floats(10.0, 5000.0))
@settings(max_examples=150, deadline=None)
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
def test_velocity_is_the_slope_of_displacement(rate):
    platen = protocol(rate)
    edges = np.append(platen.kinks, platen.duration)
    for start, stop in pairwise(edges):
        middle, step = 0.5 * (start + stop), 0.25 * (stop - start)
        rise = platen.displacement(middle + step) - platen.displacement(middle - step)
        assert rise == pytest.approx(2 * step * platen.velocity(middle), abs=1e-12)
        gain = platen.velocity(middle + step) - platen.velocity(middle - step)
        assert gain == pytest.approx(2 * step * platen.acceleration(middle), abs=1e-9)


@pytest.mark.parametrize(
    ("rate", "reached"),
    [(0.1, 0.1), (1.0, 1.0), (10.0, 10.0), (20.0, 20.0), (30.0, 30.0), (100.0, 40.0)],
)
def test_the_stroke_of_the_paper_is_too_short_for_100_mm_per_s(rate, reached):
    platen = protocol(rate)
    assert platen.velocity(platen.kinks).max() == pytest.approx(reached, rel=1e-12)


@pytest.mark.parametrize("rate", PAPER_RATES)
def test_kinks_are_where_the_acceleration_jumps(rate):
    platen = protocol(rate)
    jumps = platen.acceleration(platen.kinks + 1e-7) - platen.acceleration(platen.kinks - 1e-7)
    assert np.allclose(np.abs(jumps), np.where(platen.kinks == 0.04, 2000.0, 1000.0))
    assert platen.kinks.size == (7 if rate == 100.0 else 8)


def test_a_ramp_lasts_stroke_over_speed_plus_speed_over_acceleration():
    assert protocol(20.0).duration == pytest.approx((0.08 + 0.02) + 30 + (0.8 + 0.001) + 30)


def test_platen_rests_outside_the_program():
    platen = protocol(10.0)
    outside = np.array([-1.0, platen.duration + 1.0])
    assert platen.displacement(outside) == pytest.approx([0.0, 0.8])
    assert not platen.velocity(outside).any()
    assert not platen.acceleration(outside).any()


@pytest.mark.parametrize(
    "build",
    [
        lambda: Move(1.0, 0.0),
        lambda: Move(float("nan"), 1.0),
        lambda: Hold(0.0),
        lambda: Platen(()),
        lambda: Platen((Move(0.0, 1.0),)),
        lambda: Platen((Hold(1.0),), acceleration_limit=0.0),
    ],
)
def test_impossible_programs_are_refused(build):
    with pytest.raises(InputError):
        build()
