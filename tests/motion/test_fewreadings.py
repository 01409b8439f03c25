"""Presses that a slow logger shows by a handful of readings, against the platen's true way."""

import numpy as np
import pytest

from qlvbayes.motion.splines import Window
from qlvbayes.motion.stretch import trapezoid
from qlvbayes.motion.trajectory import smooth
from qlvbayes.simulate.platen import Hold, Move, Platen

INTERVAL = 0.02  # s
LIMIT = 1000.0  # mm/s2


FINE = np.linspace(-0.1, 0.3, 4001)
OFFSETS = pytest.mark.parametrize("offset", [0.0, 0.004, 0.011, 0.017])
RATES = pytest.mark.parametrize("rate", [20.0, 30.0, 50.0, 100.0])


def press(rate, offset, creep=0.0):
    """The way of a press to 1.6 mm; times of readings, ``offset`` (s) before one it begins."""
    platen = Platen((Move(1.6, rate), Hold(5.0, creep)), LIMIT)
    return lambda t: np.where(t < 0.0, 0.0, platen.displacement(np.maximum(t, 0.0))), (
        np.arange(-10, 250) * INTERVAL + offset
    )


@pytest.mark.parametrize("creep", [0.0, 4e-4])
@OFFSETS
@RATES
@pytest.mark.few(8)
def test_a_press_of_three_to_five_readings_goes_where_the_platen_went(rate, offset, creep):
    """And nothing overshoots that no reading shows."""
    true, time = press(rate, offset, creep)
    found = smooth(time, true(time))
    path = found.displacement(FINE)
    assert path.max() < 1.6 + 1e-3
    assert np.all(np.diff(path) > -1e-3)
    if not creep:
        assert np.max(np.abs(path - true(FINE))) < 0.01 * 1.6
        assert not found.acceleration_resolved  # the gentlest way was taken


@pytest.mark.parametrize(("rate", "offset", "creep"), [(100.0, 0.004, 0.2), (30.0, 0.017, 0.02)])
def test_a_creep_after_a_quick_press_keeps_its_speed(rate, offset, creep):
    """What few readings of the press leave open is no reason to follow the encoder's steps."""
    true, time = press(rate, offset, creep)
    x = true(time)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(x.size)
    found = smooth(time, np.round(x + noise, 3))
    speed = creep / 5.0  # mm/s, over the hold of `press`
    off = found.velocity(np.linspace(0.3, 4.5, 5001)) - speed
    assert np.max(np.abs(off)) < 0.05 * speed


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_readings_of_a_trapezoid_give_it_back(share):
    time = np.linspace(-0.2, 0.8, 21)
    s = np.clip((time - 0.03) / 0.5, 0.0, 1.0)
    early, late = s**2 / (2 * share), 1.0 - share - (1.0 - s) ** 2 / (2 * share)
    x = np.where(s < share, early, np.where(s > 1 - share, late, s - 0.5 * share)) / (1 - share)
    joints, pieces, worst = trapezoid(Window(time, 0.5 + 2.0 * x, -0.2, 0.8), 0.5, 2.5, 1e-10)
    assert worst < 1e-4
    assert joints.knots[[0, -1]] == pytest.approx([0.03, 0.53], abs=2e-3)
    assert 2.0 * pieces.c[0, 0] == pytest.approx(2.0 / (0.25 * share * (1 - share)), rel=0.02)


def test_where_nothing_moves_by_three_readings_there_is_no_trapezoid():
    time = np.arange(6.0)
    assert (
        trapezoid(Window(time, np.array([0, 0, 0.5, 1, 1, 1.0]), 0.0, 5.0), 0.0, 1.0, 0.0) is None
    )
