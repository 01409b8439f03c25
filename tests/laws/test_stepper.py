"""A stepper is the model's batch answer, draw by draw, and goes back to any of its states."""

import doctest

import numpy as np
import pytest
from support.savedfit import draws
from support.stepped import DEPTH, DT, TIME, motion_of, relative

from qlvbayes import InputError, Model, Stepper
from qlvbayes.laws import Exponential, Linear, Prony, Quadratic


def forces(stepper, depths=DEPTH):
    return np.stack([stepper.force(depth) for depth in depths[1:]])


def test_steps_are_the_batch_answer_of_every_draw_there_and_back():
    given = draws()
    found = forces(Stepper(given, DT, draws=3))
    for row, place in zip(found.T, (0, 99, 199), strict=True):
        v = np.array([given["v[1]"][place], given["v[2]"][place]])
        c = np.array([given[f"c[{k}]"][place] for k in range(3)])
        model = Model(Exponential(given["m"][place], given["b"][place]), Prony(c, v))
        assert relative(row, np.asarray(model.force(motion_of(TIME, DEPTH)))[1:]) < 1e-12
    coarse, fine = Stepper(draws(), 0.01), Stepper(draws(), 0.002)
    for depth in np.linspace(0.1, 1.6, 16):
        between = np.linspace(depth - 0.1, depth, 6)[1:]
        there = coarse.force(depth)
        assert np.allclose([fine.force(x) for x in between][-1], there, rtol=1e-12)
    forward, back = Stepper(draws(), DT, draws=8), Stepper(draws(), DT, draws=8)
    for depth in DEPTH[1:150]:
        assert np.allclose(back.displacement(forward.force(depth)), depth, rtol=1e-11)


def test_a_state_is_saved_and_restored():
    stepper = Stepper(draws(), DT, draws=8)
    forces(stepper, DEPTH[:100])
    kept = stepper.state
    first = forces(stepper, DEPTH[100:])
    stepper.restore(kept)
    assert np.array_equal(forces(stepper, DEPTH[100:]), first)
    with pytest.raises(InputError, match="another model"):
        stepper.restore(Stepper(draws(), DT, draws=7).state)


def test_the_band_holds_its_share_of_the_draws_and_one_draw_is_their_mean():
    stepper = Stepper(draws(), DT, draws=64)
    with pytest.raises(InputError, match="no step was made yet"):
        stepper.band()
    force = stepper.force(0.5)
    low, high = stepper.band(0.9)
    # each end lies between two draws
    assert np.mean((force > low) & (force < high)) == pytest.approx(0.9, abs=2 / 64)
    assert stepper.band(0.5)[0] > low
    given = draws()
    stepper = Stepper(given, DT, draws=1)
    elastic = Exponential(given["m"].mean(), given["b"].mean())
    shares = np.array([given[f"c[{k}]"].mean() for k in range(3)])
    relaxation = Prony(shares, np.array([given[f"v[{k}]"].mean() for k in (1, 2)]))
    same = Stepper(Model(elastic, relaxation), DT)
    assert same.draws == 1
    assert np.allclose(forces(stepper), forces(same), rtol=1e-12)


def test_what_cannot_be_done_is_told_in_one_line_and_leaves_the_state_alone():
    with pytest.raises(InputError, match="inertia: straight lines have no acceleration"):
        Stepper(draws(**{"inertia.mass": 1e-3}), DT)
    with pytest.raises(InputError, match="give a dt above 0"):
        Stepper(draws(), 0.0)
    stepper = Stepper(draws(), DT, draws=8)
    before = stepper.state
    for wrong in (np.nan, np.zeros(3)):
        with pytest.raises(InputError, match="next value"):
            stepper.force(wrong)
    assert np.array_equal(stepper.state.displacement, before.displacement)
    softening = Model(Quadratic(0.5, -0.2), Prony(np.array([0.4, 0.6]), np.array([2.0])))
    stepper = Stepper(softening, DT)
    place = stepper.displacement(0.1)
    with pytest.raises(InputError, match="1 of 1 draws have no displacement"):
        stepper.displacement(0.9)
    assert np.array_equal(stepper.state.displacement, place)


def test_the_docstrings_example_runs():
    import qlvbayes.use.stepper as module

    given = {"np": np, **{kind.__name__: kind for kind in (Linear, Model, Prony)}}
    found = doctest.testmod(module, extraglobs=given)
    assert (found.attempted, found.failed) == (5, 0)
